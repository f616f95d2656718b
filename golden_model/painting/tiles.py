"""Which tiles of the canvas a frame touches, by the half planes of its edges and of the horizon.

The frame's interior is where five linear functions of the canvas are positive: the distances to its four edges, times
the depth w, and w itself. Each tile is tried at that corner where the function is largest, so a tile that is left out
holds no pixel of the frame. Every tile is tried: no inverse, no bounding box, no special case at the horizon.
"""

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import SQ
from golden_model.painting.pose import ELEMENT, UNIT_LOG2, elements

TILE_PX = 32
MAX_TILES = 128
"""Columns, and rows, of the largest canvas: 4096 px."""
TESTED = SQ(18)
"""An element of a pose in this test, which needs no more than whole pixels."""
UNIT_TILES = (1 << UNIT_LOG2) // TILE_PX
SLACK = 2 * 3 * MAX_TILES
"""Cutting makes each coefficient too small, by less than 2; the three are multiplied by 128 tiles at most."""


def edges(pose: NDArray[np.int64], size: tuple[int, int]) -> NDArray[np.int64]:
    """Coefficients (5, 3) of x, y and 1 of the frame's left, right, top and bottom edge, and of the horizon.

    A pixel of the frame is 2^-12 w. The edges of a frame of ``size`` (width, height) lie a pixel outside of it, since
    positions are interpolated.
    """
    x, y, w = elements(pose) >> ELEMENT.bits - TESTED.bits
    margin = w >> UNIT_LOG2
    width, height = ((w * side) >> UNIT_LOG2 for side in size)
    return np.stack([x + margin, width - x, y + margin, height - y, w])


def touched(
    pose: NDArray[np.int64], size: tuple[int, int], tiles: tuple[int, int], *, all_tiles: bool = False
) -> NDArray[np.int64]:
    """Tiles that a frame may touch.

    Parameters
    ----------
    pose : (3, 3) int64 ndarray
        `golden_model.painting.pose.POSE`.
    size : (int, int)
        Width and height of the frame, px, at most 4096.
    tiles : (int, int)
        Columns and rows of the canvas, 1 to `MAX_TILES`.
    all_tiles : bool
        Every tile of the canvas.

    Returns
    -------
    (N, 2) int64 ndarray
        Column and row of each, row by row; every other row runs from right to left.
    """
    column, row = np.meshgrid(np.arange(tiles[0]), np.arange(tiles[1]))
    column[1::2] = column[1::2, ::-1]
    inside = np.ones(column.shape, dtype=bool)
    for x, y, constant in edges(pose, size):
        largest = x * (column + (x > 0)) + y * (row + (y > 0)) + constant * UNIT_TILES
        inside &= largest + SLACK >= 0
    found: NDArray[np.int64] = np.stack([column, row], axis=-1)[inside | all_tiles]
    return found
