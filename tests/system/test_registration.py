import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from golden_model.records import MATCH
from sim.scene import Flight, make_pair
from skymosaic import mosaic, register
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.evaluation.metrics import grid_error
from skymosaic.imagery.lens import Lens
from skymosaic.mosaicking.api import mosaic_of_pair
from skymosaic.registration.pair import Pair

VGA = (640, 480)


def error_px(pair: Pair, flight: Flight, size: tuple[int, int] = VGA) -> float:
    assert pair.accepted, pair.reason
    assert pair.homography is not None
    return grid_error(pair.homography, flight.homography_between(0, 1), size, size)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 2, 3))])
def test_rendered_pairs_are_registered_within_half_a_pixel(seed: int) -> None:
    flight = make_pair(seed=seed)
    assert error_px(register(flight.images[0], flight.images[1]), flight) < 0.5


def test_the_result_is_the_same_on_every_run() -> None:
    flight = make_pair(seed=1)
    first, second = (register(flight.images[0], flight.images[1], seed=3) for _ in range(2))
    assert first.homography is not None
    assert second.homography is not None
    assert np.array_equal(first.homography, second.homography)
    assert np.array_equal(first.inliers, second.inliers)


def test_sets_of_matches_are_nested_and_typed() -> None:
    left, right = make_pair(seed=1).images
    pair = register(left, right)
    assert pair.matches.dtype == MATCH.dtype
    assert np.all(pair.kept["verdict"] == 1)
    assert len(pair.inliers) <= len(pair.kept) <= len(pair.matches)
    assert np.all(np.isin(pair.inliers["left_index"], pair.kept["left_index"]))


def test_colour_and_gray_of_one_photograph_give_the_same_features() -> None:
    left, right = make_pair(seed=1).images
    grays = [((i.astype(int) @ [29, 150, 77] + 128) >> 8).astype(np.uint8) for i in (left, right)]
    colour, gray = register(left, right), register(grays[0], grays[1])
    assert np.array_equal(colour.matches, gray.matches)
    assert mosaic([left, right]).image.ndim == 3
    assert mosaic(grays).image.ndim == 2


def test_photographs_of_different_size() -> None:
    flight = make_pair(seed=1)
    left, right = flight.images
    cropped = right[:400, :560]
    pair = register(left, cropped)
    assert grid_error(pair.homography, flight.homography_between(0, 1), VGA, (560, 400)) < 0.5


def test_large_photographs_are_registered_reduced_and_reported_in_their_own_pixels() -> None:
    times = 3
    flight = make_pair(seed=1, size=(912, 608))
    large = [cv2.resize(image, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC) for image in flight.images]
    grow = np.array([[times, 0, (times - 1) / 2], [0, times, (times - 1) / 2], [0, 0, 1]])
    truth = grow @ flight.homography_between(0, 1) @ np.linalg.inv(grow)
    size = (912 * times, 608 * times)
    result = mosaic(large)
    pair = result.pairs[0]
    assert max(image.shape[1] for image in pair.working) == 1280
    assert grid_error(pair.homography, truth, size, size) < 1.0  # half a working pixel
    assert result.image.shape[1] > size[0]


def test_a_canvas_beyond_the_limit_is_refused_with_its_size() -> None:
    with pytest.raises(RegistrationError, match="limit"):
        mosaic(list(make_pair(seed=1).images), canvas_limit_px=100_000)


def test_two_photographs_share_a_lens() -> None:
    images = list(make_pair(seed=1).images)
    mask = np.full((480, 640), 255, np.uint8)
    mask[:120] = 0
    result = mosaic(images, lens=Lens(mask=mask))
    pair = result.pairs[0]
    assert pair.accepted
    assert min(pair.matches["left_y"].min(), pair.matches["right_y"].min()) >= 16 * 120
    # What only masked pixels would show stays empty.
    assert not result.image[:100].any()
    assert mosaic(images).image[:100].any()


def test_a_pair_is_a_flight_with_one_link() -> None:
    result = mosaic(list(make_pair(seed=1).images))
    assert result.flight.pair is result.pairs[0]
    assert [link.holds for link in result.flight.links] == [True]
    assert result.flight.layouts[0].median_error_px < 1
    shift = result.transforms[1] - np.eye(3)
    assert np.all(shift[:, :2] == 0)
    assert np.all(shift == np.rint(shift))


def test_a_registered_pair_is_blended_to_the_same_mosaic() -> None:
    images = list(make_pair(seed=1).images)
    assert np.array_equal(mosaic_of_pair(register(images[0], images[1])).image, mosaic(images).image)


def test_scale_sets_the_size_of_the_mosaic() -> None:
    images = list(make_pair(seed=1).images)
    full, half = mosaic(images).image, mosaic(images, scale=0.5).image
    assert abs(full.shape[1] / 2 - half.shape[1]) <= 1
    grown = cv2.resize(half, (full.shape[1], full.shape[0]), interpolation=cv2.INTER_LINEAR)
    middle = (slice(150, 300), slice(200, 500))
    assert np.abs(grown[middle].astype(int) - full[middle]).mean() < 12


def test_unknown_presets_and_one_image_are_refused() -> None:
    images = list(make_pair(seed=1).images)
    with pytest.raises(InputError, match="aerial, thesis"):
        register(images[0], images[1], preset="martian")
    with pytest.raises(InputError):
        mosaic(images[:1])


def test_a_thesis_frame_with_too_many_corners_raises_the_threshold_for_both() -> None:
    rng = np.random.default_rng(0)
    noise = cv2.GaussianBlur(rng.integers(0, 256, (480, 640), dtype=np.uint8), (0, 0), 1.0)
    pair = register(noise, noise, preset="thesis")
    assert pair.config.front_end.threshold > 1000
    assert 0 < len(pair.features[0]) <= pair.config.front_end.max_features
    assert pair.homography is not None
    assert np.allclose(pair.homography, np.eye(3), atol=1e-3)


def test_rotated_photographs_are_all_registered_within_a_pixel(public_data: Path) -> None:
    folder = public_data / "registration"
    with (folder / "pairs.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["group"] == "rotation_180"]
    for row in rows:
        truth = np.array([float(row[f"h{r}{c}"]) for r in range(3) for c in range(3)]).reshape(3, 3)
        pair = register(folder / row["left"], folder / row["right"])
        assert pair.accepted, row["name"]
        assert grid_error(pair.homography, truth, pair.left.size, pair.right.size) < 1.0, row["name"]


def test_warp_bends_the_left_of_two_photographs_only_where_asked() -> None:
    images = list(make_pair(seed=1).images)
    made = {warp: mosaic(images, warp=warp) for warp in ("homography", "mesh", "auto")}
    plain, bent, chosen = (each.image for each in made.values())
    assert np.array_equal(mosaic(images, repeat=made["mesh"]).image, bent)
    assert plain.shape == bent.shape
    assert np.abs(plain.astype(int) - bent).max() > 0
    assert np.array_equal(plain, chosen)  # flat ground
    with pytest.raises(InputError, match="homography, mesh, auto"):
        mosaic(images, warp="rubber")
    with pytest.raises(InputError, match="more than two"):
        mosaic([*images, images[0]], effort="thorough")


def test_the_summary_tells_effort_and_confidence() -> None:
    left, right = make_pair(seed=1).images
    summary = register(left, right).summary()
    assert summary["effort"] == "normal"
    assert summary["passes"] == 1
    assert summary["confidence"]["verdict"] == "good"
    assert summary["confidence"]["held_out_share"] > 0.9
