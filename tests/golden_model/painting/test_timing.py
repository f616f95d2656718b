"""The hardware's clocks are held against these in tests/hdl/painting/test_painter.py."""

import numpy as np
import pytest

from golden_model.painting.painter import Painter
from golden_model.painting.timing import ENDING_CYCLES, JUDGING_CYCLES, PAINTING_CYCLES, POSE_CYCLES, painting_cycles
from tests.golden_model.painting.test_painter import integers

SIZE, COLUMNS, ROWS = (320, 256), 9, 7


def cycles(pose: np.ndarray, *, replaces: bool = False) -> tuple[int, int]:
    """Clocks of a frame on an empty canvas, and how many tiles are painted."""
    plan = Painter(COLUMNS, ROWS, replace=replaces).plan(SIZE, integers(pose))
    return painting_cycles(plan, COLUMNS, ROWS), plan.counts.painted


def test_off_the_canvas_each_tile_is_only_tried() -> None:
    assert cycles(np.array([[1.0, 0, 9000], [0, 1, 0], [0, 0, 1]])) == (POSE_CYCLES + COLUMNS * ROWS, 0)


@pytest.mark.parametrize("replaces", [False, True])
def test_of_tiles_as_fine_as_the_frame_painting_takes_the_longest(replaces: bool) -> None:
    found, painted = cycles(np.array([[1.0, 0, 0.5], [0, 1, 0.5], [0, 0, 1]]), replaces=replaces)
    assert painted == COLUMNS * ROWS
    assert 0 <= found - painted * PAINTING_CYCLES - POSE_CYCLES - JUDGING_CYCLES - ENDING_CYCLES < PAINTING_CYCLES


def test_of_coarser_tiles_reading_their_windows_does() -> None:
    found, painted = cycles(np.array([[1.8, 0, -40.0], [0, 1.8, -30.0], [0, 0, 1]]))
    # A window of 60 x 60 px is 1,800 words, where it is not cut by the frame's border.
    assert 1.3 * painted * PAINTING_CYCLES < found < painted * 1800
