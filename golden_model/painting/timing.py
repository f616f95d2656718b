"""How many clocks the hardware needs to paint a frame, where memory gives and takes a word in every clock.

Blocks work on different tiles at the same time: one is projected and judged, the window of another is read, a third is
painted. Each takes its next tile when it has passed the last one on. Only a wide window is read, and painted, while
there is no other. A memory that waits makes it more, never less.
"""

import numpy as np

from golden_model.painting.corners import SIDE
from golden_model.painting.painter import Plan
from golden_model.painting.tiles import TILE_PX
from golden_model.painting.windows import are_wide

POSE_CYCLES = 628
"""From a host's pose to the first tile of the canvas that is tried, where no other frame is under way."""
JUDGING_CYCLES = 254
"""From a tile to its plan: nine corners, one after the other, and the box around them."""
READING_CYCLES = 8
"""From a plan to its window, besides the words."""
PAINTING_CYCLES = TILE_PX * TILE_PX + 2
ENDING_CYCLES = 41
"""From the last position of a tile until it is in memory."""


def painting_cycles(plan: Plan, columns: int, rows: int) -> int:
    """Predict the clocks from a pose that a host sets to the report that its frame is painted.

    Parameters
    ----------
    plan : Plan
        The frame's (`golden_model.painting.painter.Painter.plan`).
    columns, rows : int
        Size of the canvas, in tiles.
    """
    left, top, right, bottom = plan.boxes.T
    # A word of memory is two pixels, the left one of which has an even x.
    words = np.where(plan.shown, ((right >> 1) - (left >> 1) + 1) * (bottom - top + 1), 0)
    wide = plan.shown & are_wide(plan.boxes)
    tried, corner, place = POSE_CYCLES - 1, np.zeros(2, np.int64), -1
    # When each block is free for its next tile.
    judge = reader = painter = end = 0
    follows_wide = False
    for tile, count, is_wide, painted in zip(plan.tiles, words.tolist(), wide.tolist(), plan.painted, strict=True):
        column, row = tile.tolist()
        before, place = place, row * columns + (columns - 1 - column if row % 2 else column)
        tried = max(tried + place - before, judge)
        # From the last corner of one tile to the first of the next, a cell in a clock.
        way = int(np.abs((SIDE - 1) * tile - corner).sum())
        corner = (SIDE - 1) * (tile + 1)
        planned = tried + JUDGING_CYCLES + way + (way > 0)
        if painted:
            planned = max(planned, reader)
            if is_wide or (follows_wide and count):
                planned = max(planned, painter + 1)
            follows_wide = is_wide
            passed = max(planned + (READING_CYCLES + count if count else 1), painter)
            reader, painter = passed + 1, max(passed, painter) + PAINTING_CYCLES
            end = painter + ENDING_CYCLES
        judge = planned + 1
        end = max(end, judge)
    return max(end, tried + rows * columns - place)
