"""Finds matches that move with the camera: an on-screen display, dirt on the lens.

They lie at the same place in both images, so that they fit the identity better than anything on the ground, and join
photographs of different sites. From one place a camera also sees the ground stand still, but then all of it does.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from golden_model.arrays import Mask, Points, Records
from skymosaic.features.positions import feature_points, match_points

STILL_PX = 1.0
"""Matches that move less are still, in working px."""
MIN_SHARE_STILL = 0.5
"""Share of a homography's inliers that are still where it stands on what moves with the camera."""
NEARBY = 0.05
"""Radius around a still match, as a share of the image's longer side."""
MIN_SHARE_APART = 0.5
"""Share of the features that have no still match nearby, in both images: a scene that is still has them everywhere."""
STANDS_STILL = "what stands still in both pictures (a display, dirt on the lens) is not counted"
"""Note of a result that leaves such matches out."""


def remove_still(matches: Records) -> Records:
    """The match records without those at the same place in both images."""
    moving: Records = matches[~are_still(*match_points(matches))]
    return moving


def are_still(left: Points, right: Points) -> Mask:
    """Which matches are at the same place in both images, (N,)."""
    return np.asarray(np.abs(left - right).max(axis=1, initial=0.0) <= STILL_PX)


def stands_on_still_parts(left: Points, right: Points, features: tuple[Records, Records]) -> bool:
    """Whether a homography's inliers move with the camera, although the rest of the images differs.

    Parameters
    ----------
    left, right : ndarray of float64, shape (N, 2)
        Its inliers, working px.
    features : tuple of structured ndarray
        All features of the left and of the right image, working px.
    """
    still = are_still(left, right)
    if np.count_nonzero(still) <= MIN_SHARE_STILL * len(still):
        return False
    return min(_share_apart(points[still], side) for points, side in zip((left, right), features, strict=True)) > (
        MIN_SHARE_APART
    )


def _share_apart(still: Points, features: Records) -> float:
    """The share of the features without a still match nearby."""
    points = feature_points(features)
    distance, _ = cKDTree(still).query(points)
    return float(np.mean(distance > NEARBY * np.ptp(points, axis=0).max()))
