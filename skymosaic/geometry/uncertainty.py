"""Judges a fitted homography by its matches: how well it describes the scene.

The covariance of the fit would assume that the inliers' errors are independent. With relief they are not, because
neighbouring matches deviate together. So the fit is repeated without a part of the image, and the held-out matches show
how well any homography describes the scene.
"""

from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Array, Mask, Matrix, Points
from skymosaic.geometry.acceptance import CELL_PX, hull_share
from skymosaic.geometry.homography import DegenerateError, transfer_error
from skymosaic.geometry.horizon import Size
from skymosaic.geometry.prosac import INLIER_PX
from skymosaic.geometry.refinement import refine_robustly

NEAR_PX = 12.0
"""Matches this close to the homography are considered correct, though relief may have displaced them."""
FOLDS = 2
BLOCKS = 6
"""Blocks across the extent of the matches, held out like the fields of a chessboard."""


@dataclass(frozen=True)
class FitQuality:
    """Quality of a homography, measured on its matches."""

    held_out_share: float
    """Share of the held-out matches within 12 px that lie within 2 px, 0..1."""
    held_out_px: float
    """90th percentile of the errors of the held-out matches within 12 px."""
    hull_share: float
    """Area of the inliers' hull / area of the overlap, 0..1."""
    inliers: int
    """Matches within 2 px, at different places."""


def assess_fit(homography: Matrix, left: Points, right: Points, left_size: Size, right_size: Size) -> FitQuality:
    """Measure how good a homography is, by matches of which some may be wrong.

    The worst values, 12 px and a share of 0, stand for what cannot be measured.
    """
    left, right = _one_per_place(left, right)
    error_px = transfer_error(homography, left, right)
    near, inlier = error_px <= NEAR_PX, error_px <= INLIER_PX
    held_out_px = _cross_validate(homography, left[near], right[near])
    return FitQuality(
        held_out_share=float(np.mean(held_out_px <= INLIER_PX)) if len(held_out_px) else 0.0,
        held_out_px=float(np.percentile(held_out_px, 90)) if len(held_out_px) else NEAR_PX,
        hull_share=hull_share(homography, left[inlier], left_size, right_size),
        inliers=int(np.count_nonzero(inlier)),
    )


def _cross_validate(homography: Matrix, left: Points, right: Points) -> Array:
    """Errors of the matches under fits without them."""
    if len(left) < 8:
        return np.zeros(0)
    low, high = left.min(axis=0), left.max(axis=0)
    block = np.floor((left - low) / np.maximum(high - low, 1) * BLOCKS).astype(np.int64).sum(axis=1)
    error_px = np.full(len(left), np.nan)
    for fold in range(FOLDS):
        held_out: Mask = block % FOLDS == fold
        try:
            fit = refine_robustly(homography, left[~held_out], right[~held_out])
        except DegenerateError:
            continue
        error_px[held_out] = transfer_error(fit, left[held_out], right[held_out])
    return np.asarray(error_px[np.isfinite(error_px)])


def _one_per_place(left: Points, right: Points) -> tuple[Points, Points]:
    """The first match of each cell of the left image, because frames at several scales show the same corner again."""
    _, first = np.unique(np.floor(left / CELL_PX), axis=0, return_index=True)
    return left[first], right[first]
