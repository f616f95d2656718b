import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.compositing.warp import CanvasError
from skymosaic.mosaicking.live.growing_canvas import FEATHER_PX, GrowingCanvas


def shift(x: float, y: float) -> np.ndarray:
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


@pytest.fixture(scope="module")
def ground() -> np.ndarray:
    grain = np.random.default_rng(0).integers(60, 190, (240, 400, 3), dtype=np.uint8)
    return cv2.GaussianBlur(grain, (0, 0), 4)


def test_two_pictures_of_one_ground_give_the_ground(ground: NDArray[np.uint8]) -> None:
    canvas = GrowingCanvas()
    canvas.paint(ground[:, :240], shift(-30, 5), 0)
    canvas.paint(ground[:, 160:], shift(130, 5), 1)
    assert canvas.image.shape == ground.shape
    np.testing.assert_allclose(canvas.to_image, shift(30, -5))
    np.testing.assert_allclose(canvas.image, ground, atol=2)


@pytest.mark.parametrize("darker_first", [False, True])
def test_the_brighter_channels_are_darkened_to_match(ground: NDArray[np.uint8], darker_first: bool) -> None:
    tint = np.array([0.7, 1.0, 0.8])
    tinted = np.rint(ground * tint).astype(np.uint8)
    left, right = (tinted, ground) if darker_first else (ground, tinted)
    canvas = GrowingCanvas()
    canvas.paint(left[:, :240], np.eye(3), 0)
    canvas.paint(right[:, 160:], shift(160, 0), 1)
    assert np.abs(canvas.image.astype(int) - tinted).max() <= 4


def test_the_farther_border_shows(ground: NDArray[np.uint8]) -> None:
    canvas = GrowingCanvas()
    canvas.paint(ground, np.eye(3), 0)
    other = 250 - ground
    canvas.paint(other[:, :200], np.eye(3), 1)
    near = canvas.image.astype(int) - ground
    # Beyond the seam, halfway to the first picture's border, nothing of the second one is left.
    assert np.abs(near[:, 200:]).max() == 0


def test_gray_pictures_are_painted_too(ground: NDArray[np.uint8]) -> None:
    canvas = GrowingCanvas()
    canvas.paint(ground[..., 0], np.eye(3), 0)
    np.testing.assert_array_equal(canvas.image, np.repeat(ground[..., :1], 3, axis=2))


def test_what_photographs_show_moves_with_them(ground: NDArray[np.uint8]) -> None:
    """Two halves painted 6 px apart come together; seams stay closed."""
    canvas = GrowingCanvas()
    canvas.paint(ground[:, :240], np.eye(3), 3)
    canvas.paint(ground[:, 200:], shift(206, 0), 7)
    moved = GrowingCanvas()
    moved.take_over(canvas, {3: np.eye(3), 7: shift(-6, 0)}, matching=False)
    assert moved.image.shape == ground.shape
    difference = np.abs(moved.image.astype(int) - ground).max(axis=2)
    away_from_seam = np.abs(np.arange(400) - 220) > 2 * FEATHER_PX
    assert difference[:, away_from_seam].max() <= 4
    assert (moved.image > 0).all()


def test_what_is_not_named_is_not_taken_over(ground: NDArray[np.uint8]) -> None:
    canvas = GrowingCanvas()
    canvas.paint(ground[:, :100], np.eye(3), 0)
    canvas.paint(ground[:, 300:], shift(300, 0), 1)
    taken = GrowingCanvas()
    taken.take_over(canvas, {1: shift(0, 10)}, matching=True)
    np.testing.assert_array_equal(taken.image, ground[:, 300:])


def test_beyond_the_limit_nothing_changes(ground: NDArray[np.uint8]) -> None:
    canvas = GrowingCanvas(limit_px=100_000)
    canvas.paint(ground, np.eye(3), 0)
    before = canvas.image.copy()
    with pytest.raises(CanvasError, match="limit"):
        canvas.paint(ground, shift(300, 0), 1)
    other = GrowingCanvas()
    other.paint(ground, shift(300, 0), 1)
    with pytest.raises(CanvasError, match="limit"):
        canvas.take_over(other, {1: np.eye(3)}, matching=True)
    np.testing.assert_array_equal(canvas.image, before)


def test_frames_may_have_any_number(ground: NDArray[np.uint8]) -> None:
    canvas, copy = GrowingCanvas(), GrowingCanvas()
    canvas.paint(ground, np.eye(3), 70_000)
    copy.take_over(canvas, {65_535: np.eye(3), 70_000: np.eye(3)}, matching=False)
    np.testing.assert_allclose(copy.image, ground, atol=2)
