"""Accepts a homography if enough different matches agree with it, and not all in one corner.

Several frames of a pair show the same corner again, so matches are counted by place. Twelve places close together
determine no homography of a whole image: matches pooled over scales once gave 15 inliers on 4 % of an image, and an
error of 27 px.
"""

import cv2
import numpy as np

from golden_model.arrays import Matrix, Pixels, Points
from skymosaic.geometry.horizon import Size, clip_polygon, corners

CELL_PX = 4.0
"""Matches in one cell of this side count once."""
MIN_SHARE_OF_OVERLAP = 0.10
MIN_SHARE_OF_IMAGE = 0.08
"""Hull of the inliers that is large enough, as a share of the overlap, or of the smaller image."""
SHIFT_BITS = 4
"""Fractional bits of the corners that OpenCV fills a polygon by."""


def count_places(left: Points, right: Points) -> int:
    """Count matches at different places: the occupied cells, in the image with fewer of them."""
    cells = (np.floor(points.T / CELL_PX) for points in (left, right))
    # NumPy sorts complex numbers in a fraction of the time that it takes for rows.
    return min(len(np.unique(x + 1j * y)) for x, y in cells)


def overlap(homography: Matrix, left_size: Size, right_size: Size) -> Points:
    """The part of the left image that the right one shows, as a convex polygon (N, 2); N = 0 without an overlap.

    It ends at the horizon of either image, and is at least one pixel large.
    """
    polygon = corners(left_size)
    low, high = corners(right_size)[[0, 2]]
    x, y, w = homography * np.sign(np.linalg.det(homography))
    # With w > 0, x/w >= low is the half-plane x - low w >= 0. Two opposite ones exclude what has w < 0, the sky.
    for border in (x - low[0] * w, high[0] * w - x, y - low[1] * w, high[1] * w - y):
        polygon = clip_polygon(polygon, polygon @ border[:2] + border[2])
    return polygon if hull_area(polygon) >= 1 else polygon[:0]


def overlap_mask(homography: Matrix, left_size: Size, right_size: Size) -> Pixels:
    """The `overlap` as a mask of the left image: 255 where the right one shows it, else 0."""
    mask = np.zeros(left_size[::-1], np.uint8)
    polygon = np.round(overlap(homography, left_size, right_size) * 2**SHIFT_BITS).astype(np.int32)
    if len(polygon):
        cv2.fillConvexPoly(mask, polygon, 255, shift=SHIFT_BITS)
    return mask


def hull_area(points: Points) -> float:
    """Area of the convex hull, px²; 0 for fewer than three points."""
    if len(points) < 3:
        return 0.0
    return float(cv2.contourArea(cv2.convexHull(np.asarray(points, dtype=np.float32))))


def hull_share(homography: Matrix, points: Points, left_size: Size, right_size: Size) -> float:
    """Area of the left points' hull as a share of the overlap's, at most 1; 0 without an overlap."""
    area = hull_area(overlap(homography, left_size, right_size))
    return min(hull_area(points) / area, 1.0) if area > 0 else 0.0


def spread_enough(homography: Matrix, left: Points, right: Points, left_size: Size, right_size: Size) -> bool:
    """Whether the hull of the inliers covers a tenth of the overlap, or 8 % of the smaller image."""
    if hull_share(homography, left, left_size, right_size) >= MIN_SHARE_OF_OVERLAP:
        return True
    areas = [width * height for width, height in (left_size, right_size)]
    # A small part of a large image may be all that the other one shows.
    smaller = int(np.argmin(areas))
    return hull_area((left, right)[smaller]) >= MIN_SHARE_OF_IMAGE * areas[smaller]
