"""The optional second pass: matching guided by the first homography, then matching of the warped right image.

Warping the right image onto the left one removes rotation, scale and perspective. The same corners are then found in
both at the same sub-pixel phase, and upright descriptors distinguish them better than rotated ones.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from scipy.spatial.distance import cdist

from golden_model.arrays import Array, Matrix, Pixels, Records
from golden_model.config import Config, FrontEndConfig
from golden_model.front_end import extract
from golden_model.matching.hamming import distances, mutual_matches
from skymosaic.features.positions import feature_points
from skymosaic.geometry.homography import DegenerateError, apply
from skymosaic.geometry.prosac import INLIER_PX
from skymosaic.geometry.refinement import refine_robustly

GUIDED_RADIUS_PX = 8.0
"""Search radius around the position that the first homography predicts."""
WARPED_RADIUS_PX = 4.0
"""Search radius between the left and the warped right image."""
LARGEST_DISTANCE = 0.34
"""Share of differing bits at which the rule base begins to call a distance high."""


def refine_pair(
    left: Pixels, right: Pixels, features: tuple[Records, Records], homography: Matrix, config: Config
) -> tuple[Matrix, int]:
    """Refine an accepted homography of two working images.

    Parameters
    ----------
    left, right : ndarray of uint8
        The images that the front end processed.
    features : tuple of structured arrays
        Their feature records.
    homography : ndarray, shape (3, 3)
        Left to right, from the first pass.
    config : Config
        The first pass's configuration.

    Returns
    -------
    homography : ndarray, shape (3, 3)
    inliers : int
        Matches of the last search within 2 px of it.
    """
    left_points, right_points = _guided_matches(*features, homography, GUIDED_RADIUS_PX)
    guided = _fit(homography, left_points, right_points)
    size = (left.shape[1], left.shape[0])
    to_left_grid = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(right, guided, size, flags=to_left_grid)
    covered = cv2.warpPerspective(np.full(right.shape[:2], 255, np.uint8), guided, size, flags=to_left_grid)

    front_end = _upright(config.front_end)
    border_px = front_end.border_px << (front_end.levels - 1)
    warped_features = _well_inside(extract(warped.astype(np.uint8), front_end).features, covered, border_px)
    left_features = extract(left, front_end).features
    left_points, warped_points = _guided_matches(left_features, warped_features, np.eye(3), WARPED_RADIUS_PX)
    correction = _fit(np.eye(3), left_points, warped_points)
    residual = np.linalg.norm(apply(correction, left_points) - warped_points, axis=1)
    refined = guided @ correction
    return refined / refined[2, 2], int((residual <= INLIER_PX).sum())


def _guided_matches(left: Records, right: Records, homography: Matrix, radius_px: float) -> tuple[Array, Array]:
    """Mutual nearest descriptors among the features within ``radius_px`` of the position the homography predicts."""
    left_points, right_points = feature_points(left), feature_points(right)
    bits = 8 * left["descriptor"].shape[1]
    distance = distances(left["descriptor"], right["descriptor"]).astype(np.uint16)
    # All bits differ: such pairs are never the nearest, and far above LARGEST_DISTANCE.
    distance[cdist(apply(homography, left_points), right_points) > radius_px] = bits
    left_index, right_index, best, _ = mutual_matches(distance, bits)
    near = best < LARGEST_DISTANCE * bits
    return left_points[left_index[near]], right_points[right_index[near]]


def _fit(start: Matrix, left: Array, right: Array) -> Matrix:
    try:
        return refine_robustly(start, left, right)
    except (DegenerateError, ValueError):
        return start


def _upright(config: FrontEndConfig) -> FrontEndConfig:
    if not config.pattern.oriented:
        return config
    return dataclasses.replace(config, descriptor=f"{config.descriptor}-upright")


def _well_inside(features: Records, covered: Pixels, border_px: int) -> Records:
    """The features whose whole descriptor support lies inside the warped image."""
    kernel = np.ones((2 * border_px + 1, 2 * border_px + 1), np.uint8)
    interior = cv2.erode(covered, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    points = np.rint(feature_points(features)).astype(np.intp)
    inside: Records = features[interior[points[:, 1], points[:, 0]] == 255]
    return inside
