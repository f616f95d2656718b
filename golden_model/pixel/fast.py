"""FAST corners: the 9-of-16 segment test (Rosten and Drummond, 2006; thesis, equation II-1).

A pixel is a corner at threshold t if at least 9 contiguous pixels of its circle are all brighter than it by more
than t, or all darker by more than t: the strict comparison of OpenCV's TYPE_9_16. Its score is the largest
threshold it passes.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels

CIRCLE = (
    (0, -3), (1, -3), (2, -2), (3, -1), (3, 0), (3, 1), (2, 2), (1, 3),
    (0, 3), (-1, 3), (-2, 2), (-3, 1), (-3, 0), (-3, -1), (-2, -2), (-1, -3),
)  # fmt: skip
"""The Bresenham circle of radius 3 as (x, y), clockwise from the top (y down)."""
MARGIN_PX = 3


def score(gray: Pixels) -> NDArray[np.uint8]:
    """Largest threshold at which each pixel is a corner; 0 where it is not a corner at any threshold.

    Parameters
    ----------
    gray : ndarray of uint8, shape (H, W)

    Returns
    -------
    ndarray of uint8, shape (H, W)
        0 to 254; 0 within 3 px of the border.
    """
    centre = neighbour(gray, 0, 0)
    circle = [neighbour(gray, x, y) for x, y in CIRCLE]
    brightest_arc = np.maximum.reduce(_arcs(circle, np.minimum))
    darkest_arc = np.minimum.reduce(_arcs(circle, np.maximum))
    above = np.maximum(brightest_arc, centre) - centre
    below = centre - np.minimum(darkest_arc, centre)
    difference = np.maximum(above, below)
    # The test is strict (difference > t), so the largest t that passes is the difference minus 1.
    plane = np.zeros_like(gray)
    neighbour(plane, 0, 0)[:] = difference - (difference > 0)
    return plane


def response_code(gray: Pixels, threshold: int) -> NDArray[np.uint16]:
    """Scores as response codes; 0 below the threshold.

    Scores are below 1024, in the denormal range of the codes, where a code equals its value.

    Parameters
    ----------
    gray : ndarray of uint8, shape (H, W)
    threshold : int
        In gray levels, 1 to 254.

    Returns
    -------
    ndarray of uint16, shape (H, W)
        `golden_model.formats.RESPONSE_CODE`.
    """
    plane = score(gray)
    return np.where(plane >= threshold, plane, 0).astype(np.uint16)


def neighbour(plane: Pixels, x: int, y: int) -> Pixels:
    """View the neighbour at offset (x, y), y down, of every pixel at least `MARGIN_PX` from the border."""
    height, width = plane.shape
    return plane[MARGIN_PX + y : height - MARGIN_PX + y, MARGIN_PX + x : width - MARGIN_PX + x]


def _arcs(circle: list[Pixels], extreme: Callable[[Pixels, Pixels], Pixels]) -> list[Pixels]:
    """Minimum or maximum of the 9 contiguous pixels from each circle pixel on."""
    # Arcs of 2, 4, 8, then 9 pixels: 4 x 16 comparisons instead of the 8 x 16 of taking pixels one by one.
    arcs = circle
    for step in (1, 2, 4):
        arcs = [extreme(arcs[i], arcs[(i + step) % 16]) for i in range(16)]
    return [extreme(arcs[i], circle[(i + 8) % 16]) for i in range(16)]
