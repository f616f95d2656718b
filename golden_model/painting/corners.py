"""Where the corners of a tile's cells lie in the frame: exact quotients, rounded down."""

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import SQ
from golden_model.painting.pose import UNIT_LOG2, elements
from golden_model.painting.tiles import TILE_PX

CELL_PX = 16
SIDE = TILE_PX // CELL_PX + 1
"""Corners along each side of a tile."""
CORNER = SQ(15, 8)
"""A coordinate in the frame, px."""
SUM_SHIFT = UNIT_LOG2 - (CELL_PX - 1).bit_length()
"""Bits that x, y and w drop before they are divided; 30 remain."""


def project(pose: NDArray[np.int64], tiles: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Project the corners of four cells of each tile.

    Parameters
    ----------
    pose : (3, 3) int64 ndarray
        `golden_model.painting.pose.POSE`.
    tiles : (N, 2) int64 ndarray
        Columns and rows.

    Returns
    -------
    corners : (N, 3, 3, 2) int64 ndarray
        x and y of each in `CORNER`, row by row; 0 for tiles that are behind.
    behind : (N,) bool ndarray
        Tiles with a corner that is not in front of the horizon, or beyond `CORNER`.
    """
    steps = np.arange(SIDE)
    x = (tiles[:, 0] * (SIDE - 1))[:, None, None] + steps
    y = (tiles[:, 1] * (SIDE - 1))[:, None, None] + steps[:, None]
    points = np.stack(np.broadcast_arrays(x, y, 1 << SUM_SHIFT), axis=-1)
    sums = points @ elements(pose).T >> SUM_SHIFT
    depth = sums[..., 2:]
    in_front = depth > 0
    corners: NDArray[np.int64] = (sums[..., :2] << UNIT_LOG2 + CORNER.fraction_bits) // np.where(in_front, depth, 1)
    fits = in_front & (corners >= CORNER.min_raw) & (corners <= CORNER.max_raw)
    behind = np.asarray(~fits.all(axis=(1, 2, 3)))
    corners[behind] = 0
    return corners, behind
