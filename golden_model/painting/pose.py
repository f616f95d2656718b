"""Poses: homographies from the canvas to a frame, as nine integers with a common scale."""

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import SQ

UNIT_LOG2 = 12
"""Coordinates of canvas and frame have the unit 2^12 px, as those of `golden_model.geometry.scoring.quantise`."""
POSE = SQ(38)
"""An element of a pose."""
ELEMENT = SQ(28)
"""An element as the tiles and their corners take it: the error in the frame is a thousandth of a pixel."""


def elements(pose: NDArray[np.int64]) -> NDArray[np.int64]:
    """Cut a pose to `ELEMENT`."""
    return pose >> POSE.bits - ELEMENT.bits
