"""Non-maximum suppression (thesis, section III.6.1.1)."""

import cv2
import numpy as np
from numpy.typing import NDArray

TIES = ("first", "lose")


def suppress(code: NDArray[np.uint16], radius_px: int, ties: str = "first") -> NDArray[np.uint16]:
    """Keep a response only where it is the largest in the window around it.

    Parameters
    ----------
    code : ndarray of uint16, shape (H, W)
        Response codes; 0 means no response.
    radius_px : int
        The window is (2 radius_px + 1) squared. Outside the frame responses count as 0.
    ties : {"first", "lose"}
        Of equal responses in one window, keep the first in raster order (Harris) or none of them (FAST). A response is
        compared with every other response of its window, whether that one is suppressed or not. The thesis gives both
        rules for Harris (II.2.1.2: ties lose, III.6.1.1: ties survive); the first in raster order is our choice.

    Returns
    -------
    ndarray of uint16, shape (H, W)
        The code where it survives, else 0.

    Raises
    ------
    ValueError
        For an unknown value of ``ties``.
    """
    if ties not in TIES:
        raise ValueError(f"ties is {ties!r}; valid: {', '.join(TIES)}")
    side_px = 2 * radius_px + 1
    before = np.zeros((side_px, side_px), np.uint8)
    before.flat[: side_px * side_px // 2] = 1
    after = np.ascontiguousarray(before[::-1, ::-1])
    largest_after = cv2.dilate(code, after)
    survives = code >= largest_after if ties == "first" else code > largest_after
    # `code` must be greater than the earlier responses and hence than 0, so an empty window gives no corner.
    survives &= code > cv2.dilate(code, before)
    return np.asarray(code * survives, dtype=np.uint16)
