"""Rendered flights with a bending lens, vignetting, drifting exposure and white balance, over real relief."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from golden_model.cache import Cache
from golden_model.config import preset_config
from sim.scene import Flight, make_lawnmower
from skymosaic.compositing.warp import Canvas
from skymosaic.features.positions import feature_points
from skymosaic.flight.flight import Flight as SurveyedFlight
from skymosaic.flight.linking.view import Settings, describe, straighten
from skymosaic.flight.picture.preparation import compose
from skymosaic.flight.survey import survey
from skymosaic.imagery.lens import Lens, load_lens
from skymosaic.imagery.photographs import list_sources
from skymosaic.running.workers import Workers
from tests.system.command_line import closed_pipe, skymosaic, skymosaic_process
from tests.system.conftest import position_errors_px

IMAGES, SIZE, K1 = 12, (480, 360), -0.12
SURVEY: dict[str, Any] = {
    "seed": 8,
    "images": IMAGES,
    "size": SIZE,
    "forward_overlap": 0.7,
    "side_overlap": 0.5,
    "relief": True,
}
LIGHT: dict[str, Any] = {"vignetting": 0.35, "exposure_step": 0.06, "balance_sigma": 0.03}


@pytest.fixture(scope="module")
def truth() -> Flight:
    return make_lawnmower(**SURVEY, **LIGHT, k1=K1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, truth: Flight) -> Path:
    folder = tmp_path_factory.mktemp("bent")
    for index, image in enumerate(truth.images):
        cv2.imwrite(str(folder / f"{index:02}.png"), image)
    return folder


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def flight(folder: Path, cache: Path) -> SurveyedFlight:
    return surveyed([folder], cache=cache)


def surveyed(images: Sequence[Path | Pixels], lens: Lens | None = None, cache: Path | None = None) -> SurveyedFlight:
    with Workers() as workers:
        settings = Settings(preset_config("aerial"), lens=lens or Lens())
        return survey(list_sources(images), settings, 0, workers, Cache(cache))


def mean_position_error_px(flight: SurveyedFlight, truth: Flight) -> float:
    """Where the lens is straightened."""
    assert len(flight.layouts[0].members) == len(flight.views)
    return float(position_errors_px(flight.layouts[0].to_reference(flight.views), truth).mean())


def test_the_distortion_is_found_and_straightened(flight: SurveyedFlight, truth: Flight) -> None:
    numbers = flight.lens.numbers
    # Both coefficients at the same focal length: what an image shows does not tell it.
    found = numbers["k1"] * (truth.camera.focal_px / numbers["focal_x_px"]) ** 2
    assert found == pytest.approx(K1, rel=0.05)
    assert mean_position_error_px(flight, truth) < 0.25


def test_views_are_straightened_without_being_described_again(folder: Path, flight: SurveyedFlight) -> None:
    (source,), plain = list_sources([folder / "05.png"]), Settings(preset_config("aerial"))
    bent, again = describe(source, plain), describe(source, replace(plain, lens=flight.lens))
    straight = straighten(bent, flight.lens)
    for view, is_straight in ((straight, True), (bent, False)):
        away_px = np.linalg.norm(feature_points(view.features)[:, None] - feature_points(again.features), axis=2)
        # The cells of the front end choose others of the corners, where these have moved.
        assert (np.mean(away_px.min(axis=1) < 1) > 0.7) == is_straight
        assert (np.abs(view.thumbnail.astype(int) - again.thumbnail).mean() < 2) == is_straight


def test_exposures_agree_and_brightness_is_kept(flight: SurveyedFlight, truth: Flight, folder: Path) -> None:
    composition = compose(flight, flight.layouts[0])
    whole, middle = Canvas(0, 0, *SIZE), (np.array(SIZE) - 1) / 2
    y, x = np.indices(SIZE[::-1])
    squared = ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / (np.hypot(*SIZE) / 2) ** 2
    images = (np.asarray(cv2.imread(str(path))) for path in sorted(folder.iterdir()))
    kept, agreed, within = [], [], []
    for image, photometry, placement in zip(images, truth.photometries, composition.placements, strict=True):
        factors = placement.tone.factors(SIZE, whole)
        kept.append(placement.tone.apply(image, factors).mean() / image.mean())
        undone = np.log(factors * (1 - photometry.vignetting * squared)[..., None])
        agreed.append(undone.mean(axis=(0, 1)) + np.log(photometry.gain * np.array(photometry.balance)))
        within.append(undone.std(axis=(0, 1)).max())
    assert 0.97 < np.median(kept) < 1.03
    assert np.std(agreed, axis=0).max() < 0.03
    assert np.median(within) < 0.03


def test_the_lens_is_kept_beside_the_links_and_as_a_camera_file(
    folder: Path, flight: SurveyedFlight, cache: Path, truth: Flight, tmp_path: Path
) -> None:
    camera, small = tmp_path / "camera.toml", ("--scale", "0.25")
    made = skymosaic("mosaic", folder, "-o", "m.png", "--save-camera", camera, "--cache", cache, *small, cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    lens = load_lens(camera, None)
    assert lens.key == flight.calibration.lens.key
    words = "mosaic", folder, "-o", "n.png", "--save-camera", "n.toml", "--cache", cache, *small
    with closed_pipe() as pipe:
        assert skymosaic_process(*words, cwd=tmp_path, stdout=pipe).returncode == 141
    assert (tmp_path / "n.toml").read_text() == camera.read_text()
    # Below the function whose name is part of the key.
    again = "skymosaic.flight.layout.self_calibration._try"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(again, lambda *_args, **_options: pytest.fail("measured again"))
        assert surveyed([folder], cache=cache).lens.numbers == flight.lens.numbers
    with_camera = surveyed(sorted(folder.iterdir())[:4], lens)
    assert with_camera.calibration is None
    assert mean_position_error_px(with_camera, truth) < 1
