"""When a homography of the estimator is accepted: enough inliers in enough places of the frame."""

import numpy as np
from numpy.typing import NDArray

INLIER_GAIN = 26
"""Smallest gain (`golden_model.geometry.match_gain.gain`) of an inlier: its error is below 1.98 px."""
CELLS = 8
"""The right frame has 8 x 8 cells."""


def count_cells(right: NDArray[np.int64], size: tuple[int, int]) -> int:
    """Count the cells that hold any of the positions (N, 2), 1/16 px.

    What lies beyond the frame of ``size`` (width and height, px) counts for its last cells.
    """
    column = np.minimum(right[:, 0] // (16 * size[0] // CELLS), CELLS - 1)
    row = np.minimum(right[:, 1] // (16 * size[1] // CELLS), CELLS - 1)
    return len(np.unique(CELLS * row + column))
