"""Which positions count where a lens masks a part of its images (a drone's own legs, a watermark)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from golden_model.arrays import Mask, Pixels, Points, Records
from skymosaic.features.positions import match_points

MASK_MARGIN_PX = 40
"""Features keep this distance from masked pixels, in working px: farther away no descriptor reads the mask."""


def are_on_ground(points: Points, visible: Pixels | None) -> Mask:
    """Whether each point (N, 2), in working px, is far enough from masked pixels to count, (N,).

    Parameters
    ----------
    points : ndarray of float64, shape (N, 2)
    visible : ndarray of uint8, shape (H, W), or None
        255 where the working image shows ground, else 0; None: everywhere.
    """
    if visible is None:
        return np.ones(len(points), dtype=np.bool_)
    kernel = np.ones((2 * MASK_MARGIN_PX + 1, 2 * MASK_MARGIN_PX + 1), np.uint8)
    inside = cv2.erode(visible, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=255)
    x, y = np.rint(points).astype(np.intp).clip(0, np.subtract(visible.shape[::-1], 1)).T
    return np.asarray(inside[y, x] == 255)


def select_ground_matches(matches: Records, visible: Sequence[Pixels | None]) -> Records:
    """The match records whose positions count in both images; ``visible`` as in `are_on_ground`, left and right."""
    left, right = (are_on_ground(points, mask) for points, mask in zip(match_points(matches), visible, strict=True))
    chosen: Records = matches[left & right]
    return chosen
