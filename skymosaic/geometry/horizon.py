"""Where a homography of the ground ends: at the line that it maps to infinity, the horizon, beyond which lies the sky.

What it says of the sky is no place on the ground: formally the sky is mapped to the other side, behind the camera.
"""

import cv2
import numpy as np

from golden_model.arrays import Array, Matrix, Pixels, Points

Size = tuple[int, int]
"""Width and height of an image, px."""


def corners(size: Size) -> Array:
    """The outer corners (4, 2) of an image's corner pixels, whose centres are at integers."""
    right, bottom = size[0] - 0.5, size[1] - 0.5
    return np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])


def ahead(homography: Matrix, points: Points) -> Array:
    """How far points (N, 2) are on the ground's side of the horizon, in any unit: 0 on it, negative in the sky, (N,).

    It is the third homogeneous coordinate w, whose sign is arbitrary. The local scale of areas is det H / w³, and two
    photographs of the same side of the ground have the same orientation, so on the ground w has the sign of det H.
    """
    third = points @ homography[2, :2] + homography[2, 2]
    return np.asarray(third * np.sign(np.linalg.det(homography)))


def clip_polygon(polygon: Points, inside: Array) -> Points:
    """The part of a convex polygon (N, 2) in a half-plane: ``inside`` (N,), linear in the plane, is not negative there.

    It has no corner (0, 2) where nothing is left.
    """
    kept = []
    for i, (end, last) in enumerate(zip(polygon, inside, strict=True)):
        start, first = polygon[i - 1], inside[i - 1]
        if (first < 0) != (last < 0):
            kept.append(start + (end - start) * first / (first - last))
        if last >= 0:
            kept.append(end)
    return np.array(kept).reshape(-1, 2)


def warp_reflected(right: Pixels, homography: Matrix, left_size: Size) -> Pixels:
    """Warp the right image onto the left one by a homography from left to right.

    Beyond the overlap it is reflected, which has no edge that a comparison would find. At the horizon OpenCV would
    reflect a million times, for minutes: there the border is repeated.
    """
    reflects = ahead(homography, corners(left_size)).min() > 0
    border = cv2.BORDER_REFLECT if reflects else cv2.BORDER_REPLICATE
    to_left = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(right, homography, left_size, flags=to_left, borderMode=border), np.uint8)
