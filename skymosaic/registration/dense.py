"""Refits a homography to the whole overlap by dense optical flow.

Where the ground is not flat, the plane of most corners need not be the plane of most of the overlap. So the right image
is warped onto the left one, and flow is computed both ways (Kroeger and others, Fast optical flow using dense inverse
search, ECCV 2016). The points of a grid where both ways agree have equal votes, whatever their texture. The result
counts only if it predicts held-out matches better.
"""

from collections.abc import Callable

import cv2
import numpy as np

from golden_model.arrays import Mask, Matrix, Pixels, Points
from golden_model.pixel.gray import to_gray
from skymosaic.features.positions import match_points
from skymosaic.geometry.held_out import clearly_better, held_out_agreement, refit
from skymosaic.geometry.homography import apply, transfer_error
from skymosaic.geometry.prosac import INLIER_PX
from skymosaic.registration.pair import Pair

GRID_STEP_PX = 16
MAX_DISAGREEMENT_PX = 1.0
"""Forward and backward flow together may move a point by this."""
MARGIN_PX = 8
"""Flow closer to the edge of the overlap is computed from patches that reach beyond it."""
MIN_SIDE_PX = 64
MIN_GRID_POINTS = 50


def refit_pair(pair: Pair, counts: Callable[[Points, Points], Mask]) -> Pair:
    """The pair with the homography that fits the whole overlap best, or as it is where held-out matches do not gain.

    ``counts`` tells which points, left and right, show the ground.
    """
    homography = pair.working_homography
    if homography is None:
        return pair
    left, right = match_densely(to_gray(pair.working[0]), to_gray(pair.working[1]), homography)
    shown = counts(left, right)
    left, right = left[shown], right[shown]
    matches = match_points(pair.kept)
    if len(left) < MIN_GRID_POINTS:
        return pair
    by_flow, by_matches = (held_out_agreement(homography, points, matches) for points in ((left, right), matches))
    if not clearly_better(by_flow, by_matches):
        return pair
    refitted = refit(homography, left, right)
    inliers = np.count_nonzero(transfer_error(refitted, left, right) <= INLIER_PX)
    return pair.with_homography(refitted, refined_inliers=int(inliers))


def match_densely(left: Pixels, right: Pixels, homography: Matrix) -> tuple[Points, Points]:
    """Find where the points of a grid over the overlap lie in the right image.

    Parameters
    ----------
    left, right : (H, W) ndarray of uint8
        Gray images.
    homography : (3, 3) ndarray
        Left to right, about right.

    Returns
    -------
    left, right : (N, 2) float64 ndarray
        The points where flow agrees both ways; none in an overlap narrower than 64 px.
    """
    size = (left.shape[1], left.shape[0])
    to_left_grid = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    covered = cv2.warpPerspective(np.full(right.shape, 255, np.uint8), homography, size, flags=to_left_grid)
    # A reflection beyond the overlap has no edge that would draw the flow.
    warped = cv2.warpPerspective(right, homography, size, flags=to_left_grid, borderMode=cv2.BORDER_REFLECT)
    x, y, width, height = cv2.boundingRect(covered)
    if min(width, height) < MIN_SIDE_PX:
        return np.zeros((0, 2)), np.zeros((0, 2))
    box = slice(y, y + height), slice(x, x + width)
    kernel = np.ones((2 * MARGIN_PX + 1, 2 * MARGIN_PX + 1), np.uint8)
    inside = cv2.erode(covered, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)[box] == 255
    points, moved = _flow_grid(np.ascontiguousarray(left[box]), np.ascontiguousarray(warped[box]), inside)
    corner = np.array([x, y])
    return points + corner, apply(homography, moved + corner)


def _flow_grid(left: Pixels, warped: Pixels, inside: Mask) -> tuple[Points, Points]:
    """Grid points (N, 2) where flow agrees both ways, and where it moves them."""
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    forward, backward = search.calc(left, warped, None), search.calc(warped, left, None)
    grid = np.zeros_like(inside)
    grid[GRID_STEP_PX // 2 :: GRID_STEP_PX, GRID_STEP_PX // 2 :: GRID_STEP_PX] = True
    rows, columns = np.nonzero(grid & inside)
    offset = forward[rows, columns]
    moved = (np.stack((columns, rows), axis=1) + offset).astype(np.float32)
    back = cv2.remap(backward, moved[:, None], None, cv2.INTER_LINEAR, borderValue=(np.inf, np.inf))[:, 0]
    agree = np.linalg.norm(offset + back, axis=1) <= MAX_DISAGREEMENT_PX
    return np.stack((columns, rows), axis=1)[agree].astype(np.float64), moved[agree].astype(np.float64)
