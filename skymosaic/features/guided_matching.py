"""The optional second pass: warps the right image onto the left one and matches again, at three scales.

Warping removes rotation, scale and perspective. The same corners then appear in both images at the same sub-pixel
phase, and upright descriptors distinguish them better than rotated ones. The second result replaces the first only if
it fits held-out matches better.
"""

import dataclasses
import math

import cv2
import numpy as np
from scipy.spatial import KDTree

from golden_model.arrays import Array, Mask, Matrix, Pixels, Points, Records
from golden_model.config import Config, FrontEndConfig
from golden_model.front_end import extract
from skymosaic.features.frames import Change, make_frame
from skymosaic.features.positions import feature_points
from skymosaic.geometry.homography import DegenerateError, apply, transfer_error
from skymosaic.geometry.prosac import INLIER_PX
from skymosaic.geometry.refinement import refine_robustly

SEARCH_PX = 6.0
"""Search radius between the left and the warped right image, as the first homography may be a few pixels off."""
SCALES = (1.0, math.sqrt(0.5), math.sqrt(2))
MAX_DISTANCE = 0.34
"""Share of differing bits from which the rule base calls a distance high."""
BLOCK_PX = 32.0
"""Matches are held out in blocks of this side, so that a corner found at two scales is on one side only."""


def refine_pair(left: Pixels, right: Pixels, homography: Matrix, config: Config) -> tuple[Matrix, int]:
    """Refine an accepted homography of two working images.

    Parameters
    ----------
    left, right : ndarray of uint8
        The images that the front end processed.
    homography : ndarray, shape (3, 3)
        Left to right, from the first pass.
    config : Config
        The first pass's configuration.

    Returns
    -------
    homography : ndarray, shape (3, 3)
        The refined one, or the given one where it fits held-out matches at least as well.
    inliers : int
        Matches of the second pass within 2 px of it; 0 where the given homography stays.
    """
    left_points, warped_points = match_upright(left, right, homography, config.front_end)
    correction = _fit(left_points, warped_points)
    if correction is None or not _better_on_held_out(left_points, warped_points):
        return homography, 0
    inliers = transfer_error(correction, left_points, warped_points) <= INLIER_PX
    refined = homography @ correction
    return refined / refined[2, 2], int(inliers.sum())


def match_upright(left: Pixels, right: Pixels, homography: Matrix, config: FrontEndConfig) -> tuple[Points, Points]:
    """Match the left image with the right one warped onto it; returns positions (N, 2) in both, px of the left."""
    size = (left.shape[1], left.shape[0])
    to_left_grid = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = np.asarray(cv2.warpPerspective(right, homography, size, flags=to_left_grid), dtype=np.uint8)
    covered = cv2.warpPerspective(np.full(right.shape[:2], 255, np.uint8), homography, size, flags=to_left_grid)
    if config.pattern.oriented:
        config = dataclasses.replace(config, descriptor=f"{config.descriptor}-upright")
    matches = [_match_at(Change(scale), left, warped, covered, config) for scale in SCALES]
    left_points, warped_points = (np.concatenate(points) for points in zip(*matches, strict=True))
    return left_points, warped_points


def _match_at(
    change: Change, left: Pixels, warped: Pixels, covered: Pixels, config: FrontEndConfig
) -> tuple[Points, Points]:
    frames = make_frame(left, change), make_frame(warped, change)
    if frames[0] is None or frames[1] is None:
        return np.zeros((0, 2)), np.zeros((0, 2))
    to_image = frames[0].to_image
    in_left, in_warped = (extract(frame.pixels, config).features for frame in frames if frame)
    # The coarsest level's border, which its descriptors do not exceed, in pixels of the image.
    radius = math.ceil((config.border_px << (config.levels - 1)) * to_image[0, 0])
    in_warped = in_warped[_well_inside(apply(to_image, feature_points(in_warped)), covered, radius)]
    left_index, right_index = match_guided(in_left, in_warped, np.eye(3), SEARCH_PX / to_image[0, 0])
    left_points, warped_points = feature_points(in_left)[left_index], feature_points(in_warped)[right_index]
    return apply(to_image, left_points), apply(to_image, warped_points)


def match_guided(left: Records, right: Records, homography: Matrix, radius_px: float) -> tuple[Array, Array]:
    """Match features near the positions that a homography predicts.

    A match is a pair of mutually nearest descriptors among the features within ``radius_px`` of the prediction.
    Returns the indices (M,) of left and right features, in rising left index; ties go to the lowest index.
    """
    if not len(left) or not len(right):
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    expected = apply(homography, feature_points(left))
    # The tree takes no infinities.
    expected[~np.isfinite(expected).all(axis=1)] = -1e9
    near = KDTree(expected).sparse_distance_matrix(KDTree(feature_points(right)), radius_px, output_type="ndarray")
    i, j = near["i"], near["j"]
    bits = 8 * left["descriptor"].shape[1]
    distance = np.bitwise_count(left["descriptor"][i] ^ right["descriptor"][j]).sum(axis=1, dtype=np.int64)
    nearest_right = _nearest(i, j, distance, len(left))
    nearest_left = _nearest(j, i, distance, len(right))
    mutual = (nearest_right[i] == j) & (nearest_left[j] == i) & (distance < MAX_DISTANCE * bits)
    order = np.argsort(i[mutual])
    return i[mutual][order], j[mutual][order]


def _nearest(one: Array, other: Array, distance: Array, count: int) -> Array:
    """Index of each feature's nearest candidate, (count,): the lowest among equals, -1 without a candidate."""
    nearest = np.full(count, -1)
    # Later assignments overwrite earlier ones, so the best candidate comes last.
    order = np.lexsort((-other, -distance))
    nearest[one[order]] = other[order]
    return nearest


def _better_on_held_out(left: Points, warped: Points) -> bool:
    """Whether a fit to half of the matches agrees better with the other half than no correction at all."""
    block = np.floor(left / BLOCK_PX).astype(np.int64).sum(axis=1) % 2 == 0
    uncorrected, corrected = 0.0, 0.0
    for held_out in (block, ~block):
        correction = _fit(left[~held_out], warped[~held_out])
        if correction is None:
            return False
        uncorrected += _agreement(np.eye(3), left[held_out], warped[held_out])
        corrected += _agreement(correction, left[held_out], warped[held_out])
    return corrected > uncorrected


def _agreement(correction: Matrix, left: Points, warped: Points) -> float:
    squared_px = ((apply(correction, left) - warped) ** 2).sum(axis=1)
    return float(np.maximum(0, 1 - squared_px / INLIER_PX**2).sum())


def _fit(left: Points, warped: Points) -> Matrix | None:
    try:
        return refine_robustly(np.eye(3), left, warped)
    except (DegenerateError, ValueError):
        return None


def _well_inside(points: Points, covered: Pixels, radius_px: int) -> Mask:
    """Whether each point (N, 2) has nothing but the warped image within ``radius_px``, (N,)."""
    kernel = np.ones((2 * radius_px + 1, 2 * radius_px + 1), np.uint8)
    interior = cv2.erode(covered, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    x, y = np.clip(np.rint(points).astype(np.intp), 0, np.array(covered.shape[::-1]) - 1).T
    return np.asarray(interior[y, x] == 255)
