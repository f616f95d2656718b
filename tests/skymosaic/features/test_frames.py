import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import preset_config
from golden_model.front_end import extract
from golden_model.records import MATCH
from sim.backends.golden import GoldenBackend
from sim.scene import make_pair
from skymosaic.features.frames import (
    Change,
    ChangedImage,
    _line_blur,
    change_image,
    map_matches_to_images,
    map_to_image,
    swap_sides,
)
from skymosaic.features.positions import feature_points, match_points, raw_positions
from skymosaic.geometry.homography import apply

CONFIG = preset_config("aerial")
SIZE = (320, 240)


@pytest.fixture(scope="module")
def image() -> NDArray[np.uint8]:
    return make_pair(seed=1, size=SIZE).images[0][..., 1].copy()


@pytest.mark.parametrize(
    "change",
    [
        Change(2.0),
        Change(0.5),
        Change(1.0, 2**0.5, 60.0),
        Change(2.0, margin_px=20),
        Change(2.0, quarter=(1, 0)),
        Change(2.0, quarter=(0, 1)),
    ],
)
def test_a_changed_frame_matches_its_image_in_place(image: NDArray[np.uint8], change: Change) -> None:
    frame = change_image(image, change)
    matches = GoldenBackend().run([image, frame.pixels], CONFIG)[1].matches
    identity = change_image(image, Change())
    assert identity
    assert frame
    left, right = match_points(map_matches_to_images(matches, (identity, frame), (image, image)))
    close = np.linalg.norm(left - right, axis=1) < 1.5
    assert close.sum() >= 12
    assert np.median(np.linalg.norm(left - right, axis=1)[close]) < 0.6


def test_a_margin_keeps_the_corners_near_the_edges(image: NDArray[np.uint8]) -> None:
    def near_edges(margin_px: int) -> int:
        frame = change_image(image, Change(margin_px=margin_px))
        assert frame
        points = apply(frame.to_image, feature_points(extract(frame.pixels, CONFIG.front_end).features))
        from_edges_px = np.minimum(points, np.array(SIZE) - 1 - points).min(axis=1)
        return int(np.count_nonzero((from_edges_px >= 0) & (from_edges_px < 18)))

    assert near_edges(0) == 0
    assert near_edges(20) > 40


def test_quarters_have_the_corners_between_them_too(image: NDArray[np.uint8]) -> None:
    odd = image[:-1, :-3]

    def near_middle(change: Change) -> int:
        frame = change_image(odd, change)
        assert frame
        points = apply(frame.to_image, feature_points(extract(frame.pixels, CONFIG.front_end).features))
        return int(np.count_nonzero((np.abs(points - (158, 119)) < 8).any(axis=1)))

    quarters = [Change(2.0, quarter=(column, row)) for row in range(2) for column in range(2)]
    assert sum(map(near_middle, quarters)) >= near_middle(Change(2.0)) > 50


@pytest.mark.parametrize("side", ["left", "right"])
def test_matches_outside_their_images_are_dropped(image: NDArray[np.uint8], side: str) -> None:
    (width, height), moved = SIZE, np.array([[1.0, 0, -20], [0, 1, -10], [0, 0, 1]])
    frames = {"left": ChangedImage(image, np.eye(3)), "right": ChangedImage(image, np.eye(3))}
    frames[side] = ChangedImage(image, moved)
    inside, outside = [(20, 10), (width + 19, height + 9)], [(width + 20, 50), (50, height + 10), (19, 50), (50, 9)]
    matches = np.zeros(6, MATCH.dtype)
    matches[f"{side}_x"], matches[f"{side}_y"] = raw_positions(np.array(inside + outside, np.float64)).T
    found = map_matches_to_images(matches, (frames["left"], frames["right"]), (image, image))
    np.testing.assert_array_equal(match_points(found)[side == "right"], [(0, 0), (width - 1, height - 1)])


def test_frames_outside_the_range_of_the_front_end_are_refused(image: NDArray[np.uint8]) -> None:
    assert change_image(image, Change(0.2)) is None
    assert change_image(image, Change(20.0)) is None
    assert change_image(image, Change(12.7)) is not None
    assert change_image(image, Change(12.7, margin_px=20)) is None


def test_features_and_matches_lie_where_the_image_has_them(image: NDArray[np.uint8]) -> None:
    frame = change_image(image, Change(0.5))
    features = extract(frame.pixels, CONFIG.front_end).features
    assert frame
    moved = map_to_image(features, frame.to_image)
    np.testing.assert_allclose(
        feature_points(moved), apply(frame.to_image, feature_points(features)), atol=0.5 / 16 + 1e-9
    )


def test_a_tilt_compresses_along_its_direction(image: NDArray[np.uint8]) -> None:
    frame = change_image(image, Change(1.0, 2.0, 0.0))
    assert frame.pixels.shape == (SIZE[1], SIZE[0] // 2 + 1)
    np.testing.assert_allclose(frame.to_image[:2, :2], [[2, 0], [0, 1]], atol=1e-12)
    coloured = change_image(np.stack([image] * 3, axis=2), Change(1.0, 2.0, 0.0))
    np.testing.assert_array_equal(coloured.pixels, np.stack([frame.pixels] * 3, axis=2))


@pytest.mark.parametrize("tilt", [2**0.5, 2.0, 3.0])
def test_the_blur_before_it_is_that_of_asift(tilt: float) -> None:
    """A Gaussian of 0.8 sqrt(tilt^2 - 1) px along the direction, and nothing across it."""
    kernel = _line_blur(tilt, 0.6, 0.8)
    y, x = np.indices(kernel.shape) - len(kernel) // 2
    along, across = (np.sqrt((kernel * each**2).sum()) for each in (0.6 * x + 0.8 * y, 0.8 * x - 0.6 * y))
    assert along == pytest.approx(0.8 * np.sqrt(tilt**2 - 1), rel=0.1)
    assert across < 0.5


def test_swapping_twice_changes_nothing(image: NDArray[np.uint8]) -> None:
    matches = GoldenBackend().run([image, image[:200]], CONFIG)[1].matches
    assert len(matches) > 20
    other = swap_sides(matches)
    np.testing.assert_array_equal(other["left_x"], matches["right_x"])
    np.testing.assert_array_equal((other["turn"] + matches["turn"]) % 16, 0)
    np.testing.assert_array_equal(swap_sides(other), matches)
