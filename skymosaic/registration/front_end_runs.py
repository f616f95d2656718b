"""The runs of the front end that a search tries: frames of both images, enlarged, reduced, tilted, cut or inverted."""

import math
from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Matrix
from skymosaic.compositing.warp import magnification
from skymosaic.features.frames import EDGE_PX, Change

# Two octaves of each frame meet best where the zoom is a power of two; farther from it another ratio is tried.
MAX_OCTAVES_OFF = 0.19


@dataclass(frozen=True)
class FrontEndRun:
    """One run of the front end: a frame of one image, the reference, is matched with each of the other's frames."""

    reference: Change
    others: tuple[Change, ...]
    """One pass for each."""
    swapped: bool = False
    """The reference is a frame of the right image instead of the left one."""


# Half an octave either way: what lies between the octaves of the first pass meets best here. The larger frame has more
# corners, the smaller one less noise and blur.
LARGER, SMALLER = (FrontEndRun(Change(scale), (Change(scale),)) for scale in (math.sqrt(2), math.sqrt(0.5)))
# Photographs of this side have few corners, and most of a narrow overlap lies within 20 px of an edge, where the front
# end finds none. A descriptor that is a reflection in part still has enough right bits.
SMALL_PX = 400
LARGER_OF_SMALL = tuple(
    FrontEndRun(frame, (frame,)) for frame in (Change(math.sqrt(2), margin_px=EDGE_PX), Change(2.0, margin_px=EDGE_PX))
)
# Ratios of 2.8, 4 and 5 between the frames: with two octaves each, all zooms from 1.4 to 5.7 are near one of them. The
# image that shows more ground is enlarged, because little of it shows the other one.
LADDER = tuple(
    FrontEndRun(reference, reduced, swapped)
    for swapped in (False, True)
    for reference, reduced in ((LARGER.reference, (Change(0.5),)), (Change(2.0), (Change(0.5), Change(0.4))))
)
# An overlap of a few percent has few corners, and most of it lies near an edge. Twice as large, each quarter has as
# many corners as a whole frame.
_QUARTERS = tuple(Change(2.0, margin_px=EDGE_PX, quarter=(column, row)) for row in range(2) for column in range(2))
QUARTERS = tuple(FrontEndRun(quarter, _QUARTERS) for quarter in _QUARTERS)
REDUCED = (Change(0.5), Change(math.sqrt(0.125)))
INVERTED = FrontEndRun(Change(), (Change(inverted=True),))
# Either image may be the one that looks from the side; the other one is compressed. A frame matches tilts up to about
# 1.7 times steeper or flatter, in directions that lie the closer the steeper they are (ASIFT).
TILT_DIRECTIONS = {math.sqrt(2): 3, 2 * math.sqrt(2): 6, 4.0: 8}
TILTED = tuple(Change(1.0, tilt, 180 / count * i) for tilt, count in TILT_DIRECTIONS.items() for i in range(count))
TILTS = tuple(FrontEndRun(Change(), TILTED, swapped) for swapped in (False, True))


def choose_run_between_octaves(homography: Matrix, left_size: tuple[int, int]) -> FrontEndRun | None:
    """The run whose frames differ by about the zoom between the images; None where those of the first pass do."""
    zoom = magnification(left_size, homography)
    octaves = math.log2(zoom) if zoom > 0 and math.isfinite(zoom) else 0.0
    # Octaves are one apart in each frame, so zooms of 1/2, 1 and 2 meet in the first pass.
    if abs(octaves - round(octaves)) <= MAX_OCTAVES_OFF and abs(octaves) < 1 + MAX_OCTAVES_OFF:
        return None
    offsets = [abs(octaves) - math.log2(math.sqrt(2) / change.scale) for change in REDUCED]
    reduced = REDUCED[int(np.argmin([abs(offset - round(offset)) for offset in offsets]))]
    # Where the right image shows more detail it is the one that is reduced.
    return FrontEndRun(Change(math.sqrt(2)), (reduced,), swapped=octaves < 0)
