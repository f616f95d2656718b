import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from sim.scene import Flight, make_pair
from skymosaic import Mosaic, mosaic, register
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.evaluation.metrics import grid_error
from skymosaic.imagery.lens import Lens
from skymosaic.registration.pair import Pair

VGA = (640, 480)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_pair(seed=1)


@pytest.fixture(scope="module")
def images(flight: Flight) -> list[Pixels]:
    return list(flight.images)


@pytest.fixture(scope="module")
def made(images: list[Pixels]) -> Mosaic:
    """The mosaic of both."""
    return mosaic(images)


def error_px(pair: Pair, flight: Flight, size: tuple[int, int] = VGA) -> float:
    assert pair.accepted, pair.reason
    assert pair.homography is not None
    return grid_error(pair.homography, flight.homography_between(0, 1), size, size)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2, 3])
def test_rendered_pairs_are_registered_within_half_a_pixel(seed: int) -> None:
    flight = make_pair(seed=seed)
    assert error_px(register(flight.images[0], flight.images[1]), flight) < 0.5


def test_the_result_is_the_same_on_every_run(flight: Flight, images: list[Pixels], made: Mosaic) -> None:
    """Alone, too, and it is within half a pixel; the summary tells effort and confidence."""
    pair = register(images[0], images[1])
    assert error_px(pair, flight) < 0.5
    np.testing.assert_array_equal(pair.homography, made.pairs[0].homography)
    assert np.array_equal(pair.inliers, made.pairs[0].inliers)
    summary = pair.summary()
    assert summary["effort"] == "normal"
    assert summary["passes"] == 1
    assert summary["confidence"]["verdict"] == "good"
    assert summary["confidence"]["held_out_share"] > 0.9


def test_colour_and_size_may_differ(images: list[Pixels], made: Mosaic, flight: Flight) -> None:
    gray = mosaic([((i.astype(int) @ [29, 150, 77] + 128) >> 8).astype(np.uint8) for i in images])
    assert np.array_equal(made.pairs[0].matches, gray.pairs[0].matches)
    assert (made.image.ndim, gray.image.ndim) == (3, 2)
    pair = register(images[0], images[1][:400, :560])
    assert grid_error(pair.homography, flight.homography_between(0, 1), VGA, (560, 400)) < 0.5


def test_large_photographs_are_registered_reduced_and_reported_in_their_own_pixels() -> None:
    times = 2
    flight = make_pair(seed=1, size=(684, 456))
    large = [cv2.resize(image, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC) for image in flight.images]
    grow = np.array([[times, 0, (times - 1) / 2], [0, times, (times - 1) / 2], [0, 0, 1]])
    truth = grow @ flight.homography_between(0, 1) @ np.linalg.inv(grow)
    size = (684 * times, 456 * times)
    result = mosaic(large)
    pair = result.pairs[0]
    assert max(image.shape[1] for image in pair.working) == 1280
    assert grid_error(pair.homography, truth, size, size) < 1.0  # half a working pixel
    assert result.image.shape[1] > size[0]


def test_a_canvas_beyond_the_limit_is_refused_with_its_size(images: list[Pixels]) -> None:
    with pytest.raises(RegistrationError, match="limit"):
        mosaic(images, canvas_limit_px=100_000)


def test_two_photographs_share_a_lens(images: list[Pixels], made: Mosaic) -> None:
    mask = np.full((480, 640), 255, np.uint8)
    mask[:120] = 0
    result = mosaic(images, lens=Lens(mask=mask))
    pair = result.pairs[0]
    assert pair.accepted
    assert min(pair.matches["left_y"].min(), pair.matches["right_y"].min()) >= 16 * 120
    # What only masked pixels would show stays empty.
    assert not result.image[:100].any()
    assert made.image[:100].any()


def test_rotated_photographs_are_all_registered_within_a_pixel(public_data: Path) -> None:
    folder = public_data / "registration"
    with (folder / "pairs.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["group"] == "rotation_180"]
    for row in rows:
        truth = np.array([float(row[f"h{r}{c}"]) for r in range(3) for c in range(3)]).reshape(3, 3)
        pair = register(folder / row["left"], folder / row["right"])
        assert pair.accepted, row["name"]
        assert grid_error(pair.homography, truth, pair.left.size, pair.right.size) < 1.0, row["name"]


def test_photographs_of_flat_ground_keep_their_shape(images: list[Pixels], made: Mosaic) -> None:
    assert not made.layout.meshes
    with pytest.raises(InputError, match="auto, homography"):
        mosaic(images, warp="rubber")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="more than two"):
        mosaic([*images, images[0]], effort="thorough")
