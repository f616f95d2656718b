"""The whole painter against a warp in double precision, and what it counts."""

import zlib

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Array, Matrix, Pixels
from golden_model.geometry.fixed_point import quantise
from golden_model.painting.blending import FADE
from golden_model.painting.painter import Painter
from golden_model.painting.pose import Placement, Poses
from golden_model.painting.tiles import TILE_PX
from tests.golden_model.painting import tilted

SIZE, TILES = (150, 110), 8
SIDE_PX = TILES * TILE_PX


def integers(H: Matrix) -> NDArray[np.int64]:
    """A pose, from the integers that a host sends."""
    pose, causes = Poses().place(Placement(1, 0, quantise(H[np.newaxis])[0], composed=False))
    assert pose is not None, causes
    return pose


def photograph(seed: int = 0) -> Pixels:
    """Noise, as smooth as a lens makes it."""
    noise = np.random.default_rng(seed).integers(0, 256, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
    return np.asarray(cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX))


def warp(frame: Pixels, H: Matrix) -> tuple[Array, NDArray[np.bool_]]:
    """The canvas in double precision, and where it is well inside the frame."""
    y, x = np.mgrid[:SIDE_PX, :SIDE_PX].astype(float)
    at = tilted.project(H, np.stack([x, y], axis=-1))
    inside: NDArray[np.bool_] = np.all((at > 0.1) & (at < np.array(SIZE) - 1.1), axis=-1)
    at = np.where(inside[..., None], at, 0)
    whole = np.floor(at).astype(int)
    right, down = np.moveaxis(at - whole, -1, 0)[..., None]
    x, y = np.moveaxis(whole, -1, 0)
    pixels = frame.astype(float)
    upper = pixels[y, x] * (1 - right) + pixels[y, x + 1] * right
    lower = pixels[y + 1, x] * (1 - right) + pixels[y + 1, x + 1] * right
    return upper * (1 - down) + lower * down, inside


@pytest.mark.parametrize("replace", [False, True], ids=["canvas", "stabilised"])
@pytest.mark.parametrize(("zoom", "turn", "tilt"), [(0.5, 0.4, 0), (1, 2.2, 1e-4), (2, -0.8, -2e-4)])
def test_a_frame_is_where_double_precision_puts_it(zoom: float, turn: float, tilt: float, replace: bool) -> None:
    H, frame = tilted.pose(SIZE, zoom=zoom, turn=turn, tilt=tilt, tiles=TILES), photograph()
    painter = Painter(TILES, TILES, replace=replace)
    counts = painter.paint(frame, integers(H))
    expected, inside = warp(frame, H)
    picture = painter.picture.astype(float)
    assert inside.sum() > 4000
    assert counts.painted == (TILES**2 if replace else np.count_nonzero(painter.memory[..., 3].any(axis=(2, 3))))
    errors = (picture[..., :3] - expected)[inside]
    assert 10 * np.log10(255**2 / (errors**2).mean()) > 53
    assert (picture[inside, 3] > 0).all()
    # Outside there is nothing, but for the pixels at the border.
    outside = cv2.dilate(inside.astype(np.uint8), np.ones((7, 7))) == 0
    assert not picture[outside].any()


@pytest.mark.parametrize("replace", [False, True], ids=["canvas", "stabilised"])
def test_frames_are_painted_as_chips_of_before_paint_them(replace: bool) -> None:
    """What became of the tiles (`Counts`), and a checksum of the canvas."""
    painter, rng = Painter(TILES, TILES, replace=replace), np.random.default_rng(3)
    painted = []
    for zoom, turn, tilt in ((0.8, 0.4, 1e-3), (1.1, 2.2, -2e-3), (2.5, 2.2, -6e-3)):
        frame = rng.integers(0, 256, (SIZE[1], SIZE[0], 3), np.uint8)
        counts = painter.paint(frame, integers(tilted.pose(SIZE, zoom=zoom, turn=turn, tilt=tilt, tiles=TILES)))
        painted.append((*vars(counts).values(), zlib.crc32(painter.memory.tobytes())))
    assert painted == (
        [(64, 0, 0, 0, 64, 2100909833), (64, 0, 0, 0, 64, 3080052864), (64, 2, 30, 0, 64, 1706992717)]
        if replace
        else [(40, 0, 0, 1, 39, 2100909833), (27, 0, 0, 4, 23, 1813499166), (11, 0, 4, 1, 6, 893392957)]
    )


def test_where_frames_meet_the_nearer_border_loses() -> None:
    # The same light everywhere, so that a pixel says whose it is.
    dark, light = (np.full((SIZE[1], SIZE[0], 3), level, np.uint8) for level in (50, 200))
    left, right = np.eye(3), np.eye(3)
    right[0, 2] = -60
    painter = Painter(TILES, TILES)
    first = painter.paint(dark, integers(left))
    before = painter.picture.copy()
    second = painter.paint(light, integers(right))
    assert (first.painted, first.cannot_win, second.offered) == (first.offered - first.cannot_win, 0, 24)
    row = painter.picture[SIZE[1] // 2 - 2]
    # Borders are equally far away in the middle of the overlap from 60 to 149.
    middle = (60 + SIZE[0] - 1) // 2
    assert (row[: middle - FADE, 0] == 50).all()
    assert (row[middle + FADE : 200, 0] == 200).all()
    assert 100 < row[middle, 0] < 150
    # Nothing was painted where the dark frame is far better; the same frame again changes nothing.
    assert second.cannot_win > 0
    assert (painter.picture[:, :TILE_PX] == before[:, :TILE_PX]).all()
    after = painter.picture.copy()
    painter.paint(light, integers(right))
    np.testing.assert_array_equal(painter.picture[..., 3], after[..., 3])


def test_a_new_frame_forgets_the_last_one_in_stabilised_video() -> None:
    painter = Painter(TILES, TILES, replace=True)
    H = tilted.pose(SIZE, zoom=1, turn=0.3, tiles=TILES)
    away = H.copy()
    away[0, 2] += 5000
    # Off the canvas, and too large for windows.
    for nothing in (away, tilted.pose(SIZE, zoom=5, turn=0.3, tiles=TILES)):
        painter.paint(photograph(1), integers(H))
        assert painter.memory.any()
        assert painter.paint(photograph(2), integers(nothing)).painted == TILES**2
        assert not painter.memory.any()


def test_what_cannot_be_painted_is_counted() -> None:
    painter = Painter(TILES, TILES)
    far = painter.paint(photograph(), integers(tilted.pose(SIZE, zoom=5, turn=0.5, tiles=TILES)))
    # 5 px of the frame for each of the canvas: no tile fits into a window.
    assert far.too_large == far.offered > 0 == far.painted
    # The horizon crosses the canvas: nothing behind it, and no tile across it.
    tilted_up = painter.paint(photograph(), integers(tilted.pose(SIZE, zoom=0.5, turn=0, tilt=-0.012, tiles=TILES)))
    assert tilted_up.behind > 0
    total = tilted_up.behind + tilted_up.too_large + tilted_up.cannot_win + tilted_up.painted
    assert total == tilted_up.offered
