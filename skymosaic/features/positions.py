"""Positions of feature and match records in pixels and back, and which of them count under a lens mask."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Mask, Pixels, Points, Records
from golden_model.formats import POSITION

MASK_MARGIN_PX = 40
"""Features keep this distance from masked pixels, in working px: farther away no descriptor reads the mask."""


def feature_points(features: Records) -> Points:
    """Positions (N, 2) of feature records (`golden_model.records.feature_record`), working px."""
    return np.stack((features["x"], features["y"]), axis=1) / POSITION.one


def match_points(matches: Records) -> tuple[Points, Points]:
    """Left and right positions, (N, 2) each, of match records (`golden_model.records.MATCH`), working px."""
    left = np.stack((matches["left_x"], matches["left_y"]), axis=1) / POSITION.one
    right = np.stack((matches["right_x"], matches["right_y"]), axis=1) / POSITION.one
    return left, right


def raw_positions(points: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Points (N, 2) in px as the records store them (`golden_model.formats.POSITION`): 1/16 px, halves rounded up.

    Positions outside the format's range are clipped to it.
    """
    raw = np.floor(points * POSITION.one + 0.5)
    return np.asarray(np.clip(raw, POSITION.min_raw, POSITION.max_raw), dtype=np.uint16)


def are_on_ground(points: Points, visible: Pixels | None) -> Mask:
    """Whether each point (N, 2) is far enough from masked pixels to count, (N,).

    A lens mask hides what moves with the camera: the drone's own legs, a watermark. ``visible`` is 255 where the
    working image shows ground, else 0; None: everywhere.
    """
    if visible is None:
        return np.ones(len(points), dtype=np.bool_)
    kernel = np.ones((2 * MASK_MARGIN_PX + 1, 2 * MASK_MARGIN_PX + 1), np.uint8)
    inside = cv2.erode(visible, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=255)
    return np.asarray(look_up(points, inside) == 255)


def look_up(points: Points, image: NDArray[Any]) -> NDArray[Any]:
    """The value of an image (H, W) at the pixel nearest to each point (N, 2), (N,)."""
    x, y = np.rint(points).astype(np.intp).clip(0, np.subtract(image.shape[::-1], 1)).T
    return np.asarray(image[y, x])
