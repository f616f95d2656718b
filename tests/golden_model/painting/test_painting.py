"""The stages of the painter against double precision; the hardware's are held against these, and against `timing`."""

from fractions import Fraction
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from golden_model.arrays import Array, Pixels
from golden_model.painting.blending import FADE, blend
from golden_model.painting.corners import CELL_PX, CORNER, SIDE, project
from golden_model.painting.line_reader import bursts, show
from golden_model.painting.positions import POSITION, positions
from golden_model.painting.sampling import sample, weigh
from golden_model.painting.tiles import MAX_TILES, TILE_PX, touched
from tests.golden_model.painting.poses import homography, in_pixels, pose

SIZE = (1920, 1080)


def see(H: Array, points: NDArray[np.int64]) -> tuple[Array, Array]:
    """Positions in the frame, and depths."""
    mapped = points @ H[:, :2].T + H[:, 2]
    return mapped[..., :2] / mapped[..., 2:], mapped[..., 2]


def test_a_picture_shows_the_pixels_of_the_tiles_that_its_bursts_read() -> None:
    rng, columns, lines = np.random.default_rng(2), 3, TILE_PX + 5
    tiles = rng.integers(0, 256, (2, columns, TILE_PX, TILE_PX, 4), dtype=np.uint8)
    tiles[..., 3] *= rng.integers(0, 2, tiles.shape[:-1], dtype=np.uint8)
    shown = show(tiles, lines, border=0x123456)
    words = tiles.reshape(-1, TILE_PX, 4)[bursts(columns, lines)].reshape(lines, columns * TILE_PX, 4)
    assert shown.shape == words.shape[:2]
    for value, (blue, green, red, weight) in zip(shown.ravel(), words.reshape(-1, 4).tolist(), strict=True):
        assert value == (green + 256 * blue + 65536 * red if weight else 0x123456)


def test_corners_are_within_a_step_of_double_precision() -> None:
    rng = np.random.default_rng(5)
    count = 0
    for n in range(30):
        tilt = rng.normal(0, (0, 2e-4, 8e-4)[n % 3], 2)
        centre = rng.uniform(0, MAX_TILES * TILE_PX, 2)
        H = homography(SIZE, centre, zoom=2.0 ** rng.uniform(-1, 1), turn=rng.uniform(0, 7), tilt=tilt)
        tiles = touched(pose(H), SIZE, (MAX_TILES, MAX_TILES))
        corners, behind = project(pose(H), tiles)
        grid = np.stack(np.meshgrid(*[np.arange(SIDE) * CELL_PX] * 2), axis=-1)
        points = tiles[:, None, None] * TILE_PX + grid
        exact, w = see(H, points)
        # No tile that is wholly in front is lost, but for corners beyond the format.
        beyond = (np.abs(exact) > CORNER.max_raw / CORNER.one - 1).any(axis=(1, 2, 3))
        np.testing.assert_array_equal(behind & ~beyond, (w <= 0).any(axis=(1, 2)) & ~beyond)
        near = ~behind & (np.abs(exact) < 4096).all(axis=(1, 2, 3))
        count += near.sum()
        step = 1 / CORNER.one
        # Rounded down. The host's rounding of a pose adds as much again.
        for reference, error_px in ((see(in_pixels(pose(H)), points)[0], 0.001), (exact, step)):
            error = (corners * step - reference)[near]
            assert -step - error_px < error.min() < error.max() < error_px
    assert count > 50_000


def test_the_horizon_and_the_format_put_a_tile_behind() -> None:
    """With w = 1 - X / 64 the horizon is at 64 px; at 32 px, 256 X / w is 16,384 px, the format's limit."""
    for factor, wanted in ((257, [True, True, True]), (255, [False, True, True])):
        each = pose(np.array([[factor, 0, 0], [0, 1, 0], [-1 / 64, 0, 1]]))
        corners, behind = project(each, np.array([[0, 0], [1, 0], [2, 0]]))
        assert behind.tolist() == wanted
        assert not corners[behind].any()
    np.testing.assert_allclose(corners[0, 0, :, 0] / CORNER.one, [0, 16 * 255 / 0.75, 32 * 255 / 0.5], atol=0.1)


SIDE_PX = MAX_TILES * TILE_PX
SIZES = [(1920, 1080), (640, 480), (4096, 2160), (33, 4096)]


def sees(H: Array, size: tuple[int, int], x: Any, y: Any) -> NDArray[np.bool_]:
    """Whether pixels of the canvas lie in a frame."""
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in H)
    right, bottom = ((side - 1) * w for side in size)
    return np.asarray((w > 0) & (u >= 0) & (v >= 0) & (u <= right) & (v <= bottom))


def test_no_tile_is_missed() -> None:
    """Every eighth pixel of the canvas, and all pixels of the tiles around those found."""
    rng = np.random.default_rng(3)
    coarse_y, coarse_x = np.mgrid[0:SIDE_PX:8, 0:SIDE_PX:8]
    inside_y, inside_x = np.mgrid[0:TILE_PX, 0:TILE_PX]
    missed = seen = found = 0
    for n in range(16):
        size = SIZES[n % len(SIZES)]
        tilt = rng.normal(0, (0, 2e-4, 8e-4)[n % 3], 2)
        # Some frames leave the canvas, some see the horizon.
        centre = rng.uniform(-0.1, 1.1, 2) * SIDE_PX
        H = homography(size, centre, zoom=2.0 ** rng.uniform(-1, 1), turn=rng.uniform(0, 7), tilt=tilt)
        tiles = np.zeros((MAX_TILES, MAX_TILES), bool)
        column, row = touched(pose(H), size, (MAX_TILES, MAX_TILES)).T
        tiles[row, column] = True
        coarse = np.asarray(sees(H, size, coarse_x, coarse_y).reshape(MAX_TILES, 4, MAX_TILES, 4).any(axis=(1, 3)))
        near = tiles.copy()
        near[1:] |= tiles[:-1]
        near[:-1] |= tiles[1:]
        near[:, 1:] |= near[:, :-1]
        near[:, :-1] |= near[:, 1:]
        row, column = np.nonzero(near & ~coarse)
        x, y = (each[:, None, None] * TILE_PX + inside for each, inside in ((column, inside_x), (row, inside_y)))
        coarse[row, column] = sees(H, size, x, y).any(axis=(1, 2))
        missed += (coarse & ~tiles).sum()
        seen += coarse.sum()
        found += tiles.sum()
    assert seen > 30_000
    assert missed == 0
    assert found < 1.03 * seen


def test_a_pose_of_the_other_side_touches_nothing_and_all_are_found_on_demand() -> None:
    each = pose(-homography((64, 48), (60, 60)))
    assert len(touched(each, (64, 48), (3, 2))) == 0
    every = touched(each, (64, 48), (3, 2), all_tiles=True)
    assert every.tolist() == [[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]]


places = arrays(np.int64, (1, 3, 3, 2), elements=st.integers(CORNER.min_raw, CORNER.max_raw))


@given(corners=places, x=st.integers(0, TILE_PX - 1), y=st.integers(0, TILE_PX - 1), axis=st.integers(0, 1))
def test_positions_are_bilinear_between_the_corners_and_rounded_once(
    corners: np.ndarray, x: int, y: int, axis: int
) -> None:
    (column, right), (row, down) = divmod(x, CELL_PX), divmod(y, CELL_PX)
    (a, b), (c, d) = corners[0, row : row + 2, column : column + 2, axis].tolist()
    across, along = Fraction(right, CELL_PX), Fraction(down, CELL_PX)
    exact = (a * (1 - across) + b * across) * (1 - along) + (c * (1 - across) + d * across) * along
    nearest = exact * POSITION.one / CORNER.one
    assert abs(positions(corners)[0, y, x, axis] - nearest) <= Fraction(1, 2)


def bilinear(frame: Pixels, points: Array) -> Array:
    """Colours (..., 3) at points (..., 2), in double precision."""
    at = [points[..., 1], points[..., 0]]
    channels = [
        map_coordinates(frame[..., n].astype(float), at, order=1, mode="nearest") for n in range(frame.shape[2])
    ]
    return np.stack(channels, axis=-1)


@given(height=st.integers(2, 40), width=st.integers(2, 40), seed=st.integers(0, 99))
def test_colours_are_rounded_once(height: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame = rng.choice(np.array([0, 1, 128, 254, 255], np.uint8), (height, width, 3))
    at = rng.integers(-3 * POSITION.one, POSITION.one * np.array([width + 3, height + 3]), (200, 2))
    colours, weights = sample(frame, at)
    expected = np.floor(bilinear(frame, at / POSITION.one) + 0.5)
    np.testing.assert_array_equal(colours[weights > 0], expected[weights > 0])
    # Outside is where one of the four pixels is missing.
    whole = at >> POSITION.fraction_bits
    np.testing.assert_array_equal(weights > 0, ((whole >= 0) & (whole + 1 < (width, height))).all(axis=1))


@pytest.mark.parametrize(("width", "height"), [(24, 510), (511, 900), (512, 512), (1920, 1080), (4096, 4096), (2, 2)])
def test_weights_rise_from_the_border_to_the_middle_of_any_frame(width: int, height: int) -> None:
    largest = min(width, height) // 2
    weights = weigh(np.arange(-3, largest + 1), width, height)
    np.testing.assert_array_equal(weights[:5], [0, 0, 0, 0, 1])
    assert set(np.diff(weights[4:])) <= {0, 1}
    assert min(largest, 128) <= weights[-1] <= 255


def test_the_border_is_the_nearest_of_four() -> None:
    frame = np.zeros((31, 43, 3), np.uint8)
    y, x = np.indices((30, 42))
    _, weights = sample(frame, np.stack([x, y], axis=-1) * POSITION.one + 17)
    inside = np.zeros((32, 44), np.uint8)
    inside[1:-1, 1:-1] = 1
    expected = cv2.distanceTransform(inside, cv2.DIST_C, 3)[1:-1, 1:-1]
    np.testing.assert_array_equal(weights, expected)


byte = st.integers(0, 255)


def pixels(*rows: list[int]) -> np.ndarray:
    return np.array(rows, np.uint8)


@given(old=st.lists(byte, min_size=4, max_size=4), colour=st.lists(byte, min_size=3, max_size=3), weight=byte)
def test_shares_follow_the_difference_of_weights(old: list[int], colour: list[int], weight: int) -> None:
    share = min(max((weight - old[3]) / FADE + 0.5, 0), 1) if old[3] else 1
    share *= weight > 0
    expected = [np.floor(under * (1 - share) + over * share + 0.5) for under, over in zip(old[:3], colour, strict=True)]
    new = blend(pixels(old), np.array([colour]), np.array([weight]))
    assert new[0].tolist() == [*expected, max(old[3], weight)]


@given(old=st.lists(byte, min_size=4, max_size=4), colour=st.lists(byte, min_size=3, max_size=3), weight=byte)
def test_replacing_forgets_the_canvas(old: list[int], colour: list[int], weight: int) -> None:
    new = blend(pixels(old), np.array([colour]), np.array([weight]), replace=True)
    assert new[0].tolist() == ([*colour, weight] if weight else [0, 0, 0, 0])
