"""Non-maximum suppression (thesis, section III.6.1.1)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

TIES = ("first", "lose")


def suppress(code: NDArray[np.uint16], radius_px: int, ties: str = "first") -> NDArray[np.uint16]:
    """Keep a response only where it is the largest of the window around it.

    Parameters
    ----------
    code : ndarray of uint16, shape (H, W)
        Response codes; 0 is no response.
    radius_px : int
        The window is (2 radius_px + 1) squared. Outside the frame there is no response.
    ties : {"first", "lose"}
        Of equal responses in one window the first in raster order stays (Harris), or none (FAST). A response is
        compared with every other of its window, suppressed or not.

    Returns
    -------
    ndarray of uint16, shape (H, W)
        The code where it survives, else 0.

    Raises
    ------
    ValueError
        For another rule of ties.
    """
    if ties not in TIES:
        raise ValueError(f"ties is {ties!r}; valid: {', '.join(TIES)}")
    side_px = 2 * radius_px + 1
    before = np.zeros((side_px, side_px), np.uint8)
    before.flat[: side_px * side_px // 2] = 1
    after = np.ascontiguousarray(before[::-1, ::-1])
    largest_after = cv2.dilate(code, after)
    beats_later = code >= largest_after if ties == "first" else code > largest_after
    # Greater than the earlier ones, so greater than 0: an empty window gives no corner.
    return np.where((code > cv2.dilate(code, before)) & beats_later, code, 0).astype(np.uint16)
