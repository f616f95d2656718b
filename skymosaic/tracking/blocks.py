"""Blocks of a picture that are found in another by correlation, where features are too few: below text, or blurred."""

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Pixels
from golden_model.pixel.gray import to_gray

BLOCK_PX, STEP_PX, REACH_PX = 8, 6, 20
"""Side of a block, the distance of two, and how far one is sought from its place, in pictures of half size."""
BORDER_PX = 2 * REACH_PX + BLOCK_PX
"""At least so far the middle of a block is from the border of its picture."""
MIN_CORRELATION = 0.85
"""Of 100 blocks that correlate so well with other ground, at most 6 agree on a motion."""
MIN_CONTRAST = 2.0
"""Standard deviation of a block's gray levels; what is flatter correlates anywhere."""


def match_blocks(reference: Pixels, picture: Pixels, middles: Array) -> tuple[Array, Array]:
    """Find blocks of a picture in another one of the same size, by the correlation of what differs from their means.

    ``middles`` (N, 2), at least `BORDER_PX` from the border, say which blocks. Returns the middles of those that are
    found, in both pictures, (M, 2) each.
    """
    before, now = (cv2.pyrDown(to_gray(each)) for each in (reference, picture))
    first: NDArray[np.intp] = np.floor((middles - BLOCK_PX + 1) / 2).astype(np.intp)
    found = []
    for x, y in first.tolist():
        block = before[y : y + BLOCK_PX, x : x + BLOCK_PX]
        if block.std() < MIN_CONTRAST:
            continue
        around = now[y - REACH_PX : y + BLOCK_PX + REACH_PX, x - REACH_PX : x + BLOCK_PX + REACH_PX]
        _, correlation, _, place = cv2.minMaxLoc(cv2.matchTemplate(around, block, cv2.TM_CCOEFF_NORMED))
        if correlation >= MIN_CORRELATION:
            found.append(((x, y), (x + place[0] - REACH_PX, y + place[1] - REACH_PX)))
    both = 2 * np.array(found, dtype=np.float64).reshape(-1, 2, 2) + BLOCK_PX - 1
    return both[:, 0], both[:, 1]
