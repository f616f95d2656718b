"""Cells of the frame in which inliers lie."""

import numpy as np

from golden_model.geometry.acceptance import INLIER_GAIN, count_cells
from golden_model.geometry.match_gain import LEVELS, TOLERANCE_PX


def test_cells_are_eighths_of_the_frame() -> None:
    size = (650, 487)
    edges = np.array([2 * 650, 2 * 487])
    inside = np.array([[0, 0], edges - 1])
    assert count_cells(inside, size) == 1
    assert count_cells(np.vstack((inside, [edges])), size) == 2
    assert count_cells(np.array([[16 * 650 - 1, 16 * 487 - 1], [65535, 65535]]), size) == 1
    centres = np.array([(2 * column + 1, 2 * row + 1) for column in range(8) for row in range(8)]) * edges // 2
    assert count_cells(np.repeat(centres, 2, axis=0), size) == 64
    assert count_cells(centres[:0], size) == 0


def test_an_inlier_is_within_two_pixels() -> None:
    # The gain is 32 (1 - e² / 2 tau²), rounded up.
    steps = LEVELS - INLIER_GAIN + 1
    assert 1.95 < np.sqrt(2 * steps / LEVELS) * TOLERANCE_PX < 2
