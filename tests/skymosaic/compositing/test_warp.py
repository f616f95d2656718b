import cv2
import numpy as np
import pytest

from golden_model.arrays import Array, Pixels
from skymosaic.compositing.warp import (
    TILE_PX,
    Canvas,
    CanvasError,
    enclosing_canvas,
    footprint,
    magnification,
    shrink,
    source_window,
    warp_backward,
)
from skymosaic.geometry.homography import apply

PROJECTIVE = np.array([[0.9, 0.2, 30.0], [-0.15, 1.1, 20.0], [2e-4, -1e-4, 1.0]])


def shift(x: float, y: float) -> Array:
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


def noise_image(height: int, width: int, *channels: int, seed: int = 0) -> Pixels:
    return np.random.default_rng(seed).integers(0, 256, (height, width, *channels), dtype=np.uint8)


def smooth_image(height: int, width: int, *channels: int, seed: int = 0) -> Pixels:
    return cv2.GaussianBlur(noise_image(height, width, *channels, seed=seed), (0, 0), 4)


def test_rectangles_and_their_tiles() -> None:
    left, right = Canvas(0, 0, 10, 5), Canvas(8, -2, 10, 5)
    assert left.intersection(right) == Canvas(8, 0, 2, 3)
    assert left.intersection(Canvas(10, 0, 3, 3)) is None
    assert left.intersection(Canvas(0, 5, 3, 3)) is None
    assert left.intersection(Canvas(9, 4, 3, 3)) == Canvas(9, 4, 1, 1)
    assert Canvas(8, 0, 2, 3).within(right) == (slice(2, 5), slice(0, 2))
    np.testing.assert_array_equal(apply(right.translation, right.corners[0]), (0, 0))
    canvas = Canvas(-3, 7, 25, 11)
    hits = np.zeros((11, 25), dtype=int)
    for tile in canvas.tiles(8):
        assert max(tile.width_px, tile.height_px) <= 8
        hits[tile.within(canvas)] += 1
    assert (hits == 1).all()


def test_a_canvas_holds_all_images_within_its_limit() -> None:
    canvas = enclosing_canvas([(100, 50), (80, 60)], [shift(-20.5, 3), np.eye(3)])
    assert canvas == Canvas(-20, 0, 100, 60)
    assert enclosing_canvas([(100, 50)], [np.eye(3) + 1e-12]) == Canvas(0, 0, 100, 50)
    with pytest.raises(CanvasError, match=r"100100x100 px, 10 megapixels; the limit is 5"):
        enclosing_canvas([(100, 100), (100, 100)], [np.eye(3), shift(100_000, 0)], limit_px=5_000_000)


@pytest.mark.parametrize("sign", [1, -1])
def test_image_that_reaches_behind_the_camera_is_refused(sign: int) -> None:
    horizon = np.array([[1.0, 0, 0], [0, 1, 0], [-1 / 90, 0, 1]])
    assert footprint((80, 100), sign * horizon).width_px == 647
    for width in (91, 120):
        with pytest.raises(CanvasError, match=f"{width}x100 px would lie behind the camera"):
            enclosing_canvas([(width, 100)], [sign * horizon])


def test_the_magnification_is_that_of_the_area_in_the_middle() -> None:
    assert magnification((301, 201), shift(70, -30) @ np.diag([2.0, 4.5, 1])) == pytest.approx(3)
    # In the middle the denominator is 1, a pixel to the right 1.002, and a pixel below 1.001.
    leaning = np.array([[2.0, 0, 0], [0, 2, 0], [2e-3, 1e-3, 1 - 0.3 - 0.1]])
    right, below = np.array([302, 200]) / 1.002, np.array([300, 202]) / 1.001
    area = np.linalg.det([right - (300, 200), below - (300, 200)])
    assert magnification((301, 201), leaning) == pytest.approx(np.sqrt(area), rel=1e-9)


def test_backward_against_a_textbook_loop() -> None:
    image = smooth_image(50, 70)
    canvas = Canvas(20, 10, 60, 45)
    warped = warp_backward(image, PROJECTIVE, canvas)
    checked = 0
    for y in range(0, 45, 4):
        for x in range(0, 60, 4):
            u, v = apply(np.linalg.inv(PROJECTIVE), (x + 20, y + 10))
            if 0 <= u <= 69 and 0 <= v <= 49:
                column, row = min(int(u), 68), min(int(v), 48)
                a, b = u - column, v - row
                corners = image[row : row + 2, column : column + 2].astype(float)
                assert abs(warped[y, x] - [1 - b, b] @ corners @ [1 - a, a]) <= 0.6
                checked += 1
    assert checked > 60


def test_tiles_leave_no_trace_nor_does_the_limit_of_opencv() -> None:
    image = smooth_image(900, 1500, 3)
    large = Canvas(0, 0, 2 * TILE_PX + 100, TILE_PX + 50)
    by_tiles = warp_backward(image, PROJECTIVE @ np.diag([1.4, 1.4, 1]), large)
    at_once = cv2.warpPerspective(image, PROJECTIVE @ np.diag([1.4, 1.4, 1]), (large.width_px, large.height_px))
    assert (by_tiles > 0).mean() > 0.5
    assert np.abs(by_tiles.astype(int) - at_once).max() <= 1
    wide = noise_image(3, 40_000)
    np.testing.assert_array_equal(warp_backward(wide, shift(5, 0), Canvas(5, 0, 40_000, 3)), wide)


def test_what_of_a_source_a_tile_needs() -> None:
    horizon = np.array([[1.0, 0, 0], [0, 1, 0], [-1 / 90, 0, 1]])
    tile = Canvas(-300, 0, 400, 50)
    assert source_window((80, 100), horizon, tile) == Canvas(0, 0, 80, 100)
    assert (warp_backward(np.full((100, 80), 200, np.uint8), horizon, tile)[:, 310:] == 200).all()
    assert source_window((60, 40), np.eye(3), Canvas(200, 0, 10, 10)) == Canvas(59, 0, 1, 15)
    assert source_window((60, 40), np.eye(3), Canvas(50, 30, 100, 100)) == Canvas(45, 25, 15, 15)


def test_shrunk_keeps_the_geometry_and_averages() -> None:
    image = noise_image(120, 180)
    scale = np.array([[0.25, 0, -0.375], [0, 0.25, -0.375], [0, 0, 1]])
    small, transform = shrink(image, scale)
    assert small.shape == (30, 45)
    np.testing.assert_allclose(transform, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(small, image.reshape(30, 4, 45, 4).mean(axis=(1, 3)), atol=0.51)
    assert shrink(image, 0.6 * np.eye(3) + np.diag([0, 0, 0.4]))[0] is image


def test_an_image_that_reaches_to_the_horizon_has_no_footprint() -> None:
    # At the right border, the third coordinate is 1e-13.
    ahead = np.array([[1.0, 0, 0], [0, 1, 0], [(1e-13 - 1) / 99, 0, 1]])
    with pytest.raises(CanvasError, match="100x80 px would reach to the horizon"):
        footprint((100, 80), ahead)
