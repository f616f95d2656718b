"""Refits a homography to the whole overlap by dense optical flow.

Where the ground is not flat, the plane of most corners need not be the plane of most of the overlap. So the right image
is warped onto the left one, and flow is computed both ways (Kroeger and others, Fast optical flow using dense inverse
search, ECCV 2016). The points of a grid where both ways agree have equal votes, whatever their texture, and the search
begins again with them. The result counts only if it explains more of the overlap, or held-out points better.
"""

from collections.abc import Callable

import cv2
import numpy as np

from golden_model.arrays import Mask, Matrix, Pixels, Points
from golden_model.pixel.gray import to_gray
from skymosaic.features.positions import match_points
from skymosaic.geometry.acceptance import overlap_mask
from skymosaic.geometry.held_out import clearly_better, held_out_agreement
from skymosaic.geometry.homography import apply, transfer_error
from skymosaic.geometry.horizon import warp_reflected
from skymosaic.geometry.prosac import INLIER_PX, estimate_homography
from skymosaic.registration.pair import Pair

GRID_STEP_PX = 16
MAX_DISAGREEMENT_PX = 1.0
"""Forward and backward flow together may move a point by this."""
MARGIN_PX = 8
"""Flow closer to the edge of the overlap is computed from patches that reach beyond it."""
MIN_SIDE_PX = 64
MIN_GRID_POINTS = 50


def refit_pair(pair: Pair, shows_ground: Callable[[Points, Points], Mask]) -> Pair:
    """The pair with the homography that fits most of the overlap, or its own where that gains too little.

    ``shows_ground`` tells which points, left and right, count.
    """
    homography = pair.working_homography
    if homography is None:
        return pair
    left, right = match_densely(to_gray(pair.working[0]), to_gray(pair.working[1]), homography)
    counted = shows_ground(left, right)
    left, right = left[counted], right[counted]
    if len(left) < MIN_GRID_POINTS:
        return pair
    inliers = int(np.count_nonzero(transfer_error(homography, left, right) <= INLIER_PX))
    rng = np.random.default_rng(0)
    found = estimate_homography(left, right, np.ones(len(left)), rng=rng, starts=[homography])
    gained = int(np.count_nonzero(found.inliers))
    if found.homography is not None and (
        clearly_better(gained, inliers)
        # Errors that were below 2 px already do not change that count.
        or clearly_better(
            held_out_agreement(found.homography, (left, right), (left, right)),
            held_out_agreement(homography, match_points(pair.kept), (left, right)),
        )
    ):
        return pair.with_homography(found.homography, refined_inliers=gained)
    return pair


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
    covered = overlap_mask(homography, size, (right.shape[1], right.shape[0]))
    warped = warp_reflected(right, homography, size)
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
