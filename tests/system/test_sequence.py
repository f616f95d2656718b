import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.cache import Cache
from golden_model.config import preset_config
from sim.scene import Flight
from skymosaic import mosaic
from skymosaic.common.errors import InputError
from skymosaic.flight.flight import Flight as SurveyedFlight
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.survey import survey
from skymosaic.imagery.photographs import list_sources
from skymosaic.running.workers import Workers
from tests.made import write_pictures
from tests.system.command_line import only_error, skymosaic
from tests.system.conftest import IMAGES, SIZE, position_errors_px


def elsewhere(images: int) -> list[np.ndarray]:
    """Overlapping pictures of another place."""
    grain = np.random.default_rng(9).integers(0, 256, (SIZE[1], SIZE[0] * 2, 3), dtype=np.uint8)
    ground = cv2.GaussianBlur(grain, (0, 0), 2)
    return [ground[:, 90 * index : 90 * index + SIZE[0]] for index in range(images)]


def survey_anew(images: list[Any]) -> SurveyedFlight:
    with Workers() as workers:
        return survey(list_sources(images), Settings(preset_config("aerial")), 0, workers, Cache(None))


def test_the_order_of_the_images_does_not_matter_for_where_they_lie(flight: Flight) -> None:
    images = list(flight.images)
    shuffled = np.random.default_rng(0).permutation(IMAGES)
    result = mosaic([images[index] for index in shuffled], scale=0.5)
    found = {int(shuffled[index]): transform for index, transform in result.transforms.items()}
    assert len(found) == IMAGES
    assert position_errors_px(found, flight).mean() < 1.0


def test_unusable_photographs_are_left_out_with_their_names(folder: Path, surveyed: Path, tmp_path: Path) -> None:
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "copy.png").write_bytes((folder / "3.png").read_bytes())
    (tmp_path / "corrupt.png").write_bytes((folder / "4.png").read_bytes()[:5000])
    cv2.imwrite(str(tmp_path / "flat.png"), np.full((360, 480), 90, np.uint8))
    result = mosaic([tmp_path], cache=surveyed, scale=0.25)
    names = [source.name for source in list_sources([tmp_path])]
    reasons = {Path(names[index]).name: reason for index, reason in result.left_out.items()}
    assert set(reasons) == {"copy.png", "corrupt.png", "flat.png"}
    assert "3.png" in reasons["copy.png"]
    assert "truncated" in reasons["corrupt.png"]
    assert "too few features" in reasons["flat.png"]
    assert len(result.placed) == IMAGES


def test_sizes_may_differ(flight: Flight, surveyed: Path) -> None:
    images = list(flight.images)
    images[2] = images[2][:300, :420]
    images[5] = cv2.resize(images[5], (960, 720), interpolation=cv2.INTER_CUBIC)
    result = mosaic(images, cache=surveyed, scale=0.5)
    assert len(result.placed) == IMAGES
    magnified = result.transforms[5] @ np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    assert position_errors_px(result.transforms | {5: magnified}, flight).mean() < 1.0


def test_photographs_without_links_are_one_line(flight: Flight, tmp_path: Path) -> None:
    write_pictures(tmp_path, (flight.images[0], *elsewhere(1), flight.images[IMAGES - 1]))
    result = skymosaic("mosaic", tmp_path, "-o", "m.png", "--cache", "cache", cwd=tmp_path)
    assert result.returncode == 3
    assert "12 are needed" in only_error(result.stderr)
    assert not (tmp_path / "m.png").exists()


def test_a_flight_of_16_bits_keeps_its_numbers(flight: Flight, tmp_path: Path) -> None:
    """Each photograph fills a different part of the range, as automatic exposure makes it; one has a highlight."""
    for index, image in enumerate(flight.images[:4]):
        deep = 9000 + image[..., 1].astype(np.uint16) * (80 + 10 * index)
        deep[:20, :20] = 65_535
        cv2.imwrite(str(tmp_path / f"{index}.tif"), deep)
    made = mosaic([tmp_path])
    assert made.image.dtype == np.uint16
    ordinary = mosaic([np.ascontiguousarray(image[..., 1]) for image in flight.images[:4]]).image
    expected = 9000 + 95 * np.percentile(ordinary[ordinary > 0], (10, 50, 90))
    np.testing.assert_allclose(np.percentile(made.image[made.image > 0], (10, 50, 90)), expected, rtol=0.03)


def test_groups_are_several_mosaics_and_the_detector_applies(flight: Flight) -> None:
    with pytest.raises(InputError, match=r"mosaics\(\)"):
        mosaic(list(flight.images), all_groups=True)
    result = mosaic(list(flight.images)[:3], detector="fast")
    assert result.flight.settings.config.front_end.detector == "fast"
    assert len(result.placed) == 3


def test_check_tells_whether_the_flight_is_complete(folder: Path, surveyed: Path, tmp_path: Path) -> None:
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    first = min(tmp_path.glob("*.png"))
    data = bytearray(cv2.imencode(".jpg", cv2.imread(str(first)))[1].tobytes())
    data[-3000:-2600] = bytes(400)
    first.unlink()
    first.with_suffix(".jpg").write_bytes(data)
    for choice, left_out in (("keep", 0), ("refuse", 1)):
        damaged = skymosaic("check", tmp_path, "--json", "--cache", surveyed, "--damaged", choice, cwd=tmp_path)
        assert damaged.returncode == 0, damaged.stderr
        found = json.loads(damaged.stdout)
        assert (found["complete"], len(found["left_out"])) == (True, left_out)
    cv2.imwrite(str(tmp_path / "z.png"), elsewhere(1)[0])
    broken = skymosaic("check", tmp_path, "--json", "--cache", surveyed, cwd=tmp_path)
    assert broken.returncode == 3
    found = json.loads(broken.stdout)
    assert not found["complete"]
    assert "linked with no other photograph" in found["photographs"][-1]["problems"]


def test_a_killed_run_goes_on_and_ends_the_same(folder: Path, surveyed: Path, tmp_path: Path) -> None:
    photographs = sorted(folder.iterdir())[:4]
    words = ["mosaic", *map(str, photographs), "-o", "m.png", "--cache", "cache"]
    command = [sys.executable, "-m", "skymosaic", *words]
    first = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while len(list(tmp_path.glob("cache/*.entry"))) < 2 and first.poll() is None:
        time.sleep(0.02)
    first.send_signal(signal.SIGKILL)
    first.wait()
    assert list(tmp_path.glob("cache/*.entry"))
    resumed = skymosaic(*words, cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    whole = mosaic(photographs, cache=surveyed)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "m.png")), whole.image)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "images"), [("brighton_beach", 18), ("copr", 41)])
def test_public_flights_are_placed_whole(public_data: Path, name: str, images: int) -> None:
    flight = survey_anew([public_data / "flights" / name])
    assert [len(layout.members) for layout in flight.layouts] == [images]
    wide = 1600 / flight.views[0].working_size[0]
    assert flight.layouts[0].median_error_px * wide < 1.5
