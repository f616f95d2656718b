"""Positions of a tile's pixels in the frame: bilinear between the corners of its cells, which takes nothing but adders.

The exact positions are ratios. Within a cell of 16 px the bilinear surface is off by .01 px for a level camera, and by
1 px at a tilt of 8e-4 per px, where the far side of the frame is twice as far away as the near one (measured).
"""

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import SQ, round_shift
from golden_model.painting.corners import CELL_PX, CORNER
from golden_model.painting.tiles import TILE_PX

POSITION = SQ(14, 6)
"""x or y of a pixel in the frame, in 1/64 px; pixel centres are integers."""
CELL_LOG2 = CELL_PX.bit_length() - 1
EDGE_BITS = CORNER.fraction_bits + CELL_LOG2
"""Bits after the point on the left and right edges of a cell."""
EXACT_BITS = EDGE_BITS + CELL_LOG2
"""Bits after the point of a pixel's position before it is rounded."""


def positions(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Interpolate the positions of the pixels of tiles.

    The position n px below a cell's upper corners is an n/16 of the way on its left and right edges, and then n/16
    between these; rounded once, halves up.

    Parameters
    ----------
    corners : ndarray of int, shape (N, 3, 3, 2)
        x, y of the corners of each tile's cells, row by row, in 1/256 px.

    Returns
    -------
    ndarray of int64, shape (N, 32, 32, 2)
        `POSITION` of the pixels, row by row.
    """
    along = np.arange(CELL_PX)
    # Axes: tile, row of cells, row in the cell, corner of the row, x and y.
    upper, lower = corners[:, :-1, None], corners[:, 1:, None]
    edges = upper * CELL_PX + along[:, None, None] * (lower - upper)
    # Axes: tile, row of cells, row in the cell, cell, column in the cell, x and y.
    left, right = edges[:, :, :, :-1, None], edges[:, :, :, 1:, None]
    exact = left * CELL_PX + along[:, None] * (right - left)
    rounded = round_shift(exact, EXACT_BITS - POSITION.fraction_bits)
    return rounded.reshape(len(corners), TILE_PX, TILE_PX, 2)
