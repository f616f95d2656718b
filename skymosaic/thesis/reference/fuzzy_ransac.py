"""Fuzzy RANSAC as the thesis's text describes it: four random matches are decided together."""

import numpy as np
from numpy.typing import ArrayLike

from golden_model.arrays import Array, Mask
from skymosaic.geometry.fuzzy_ransac import TOLERANCE_PX, error_steps, rule_base

FOURS = 2000
"""Number of sets of four matches that are drawn."""


def decide_by_fours(
    H: Array,
    left: ArrayLike,
    right: ArrayLike,
    verified: ArrayLike,
    *,
    rng: np.random.Generator,
    fours: int = FOURS,
    tolerance_px: float = TOLERANCE_PX,
) -> Mask:
    """Decide sets of four random matches: if all are verified and all errors are at most tau, all four are inliers.

    Parameters as in `skymosaic.geometry.fuzzy_ransac.decide`; ``fours`` is the number of sets drawn. A match is an
    inlier if any of its sets is accepted, so with many draws the result tends to that of `decide`, provided there
    are at least four inliers.

    Returns
    -------
    (N,) bool ndarray
    """
    checks, errors = np.asarray(verified, dtype=np.int64), error_steps(H, left, right, tolerance_px)
    inliers = np.zeros(len(checks), dtype=bool)
    if len(checks) < 4:
        return inliers
    drawn = np.stack([rng.choice(len(checks), size=4, replace=False) for _ in range(fours)])
    weight, _ = rule_base(tolerance_px).evaluate(checks[drawn].min(axis=1), errors[drawn].max(axis=1))
    inliers[drawn[weight > 0]] = True
    return inliers
