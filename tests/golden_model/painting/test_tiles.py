"""No tile is missed that a pixel of the frame falls into, by double precision, and few are found in vain."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.painting.tiles import MAX_TILES, TILE_PX, touched
from tests.golden_model.painting.poses import homography, pose

SIDE_PX = MAX_TILES * TILE_PX
SIZES = [(1920, 1080), (640, 480), (4096, 2160), (33, 4096)]


def sees(H: NDArray[np.float64], size: tuple[int, int], x: Any, y: Any) -> NDArray[np.bool_]:
    """Whether pixels of the canvas lie in a frame."""
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in H)
    right, bottom = ((side - 1) * w for side in size)
    return np.asarray((w > 0) & (u >= 0) & (v >= 0) & (u <= right) & (v <= bottom))


def test_none_of_100_000_tiles_is_missed() -> None:
    """Every eighth pixel of the canvas, and all pixels of the tiles around those found."""
    rng = np.random.default_rng(3)
    coarse_y, coarse_x = np.mgrid[0:SIDE_PX:8, 0:SIDE_PX:8]
    inside_y, inside_x = np.mgrid[0:TILE_PX, 0:TILE_PX]
    missed = seen = found = 0
    for n in range(48):
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
    assert seen > 100_000
    assert missed == 0
    assert found < 1.03 * seen


def test_a_pose_of_the_other_side_touches_nothing_and_all_are_found_on_demand() -> None:
    each = pose(-homography((64, 48), (60, 60)))
    assert len(touched(each, (64, 48), (3, 2))) == 0
    every = touched(each, (64, 48), (3, 2), all_tiles=True)
    assert every.tolist() == [[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]]
