"""Fuzzy RANSAC as the thesis's text describes it: four random matches are accepted or rejected together."""

import numpy as np
from numpy.typing import ArrayLike

from golden_model.arrays import Array, Mask
from skymosaic.geometry.fuzzy_ransac import error_steps, rule_base

SETS = 2000
"""Number of random sets of four matches."""


def decide_in_sets_of_four(
    H: Array, left: ArrayLike, right: ArrayLike, verified: ArrayLike, *, rng: np.random.Generator, sets: int = SETS
) -> Mask:
    """Decide sets of four random matches: if all are verified and all errors are at most tau, all four are inliers.

    Parameters as in `skymosaic.geometry.fuzzy_ransac.decide`; ``sets`` is the number of sets drawn. A match is an
    inlier if any of its sets is accepted, so with many sets the result tends to that of `decide`, provided there
    are at least four inliers, (N,).
    """
    checks, errors = np.asarray(verified, dtype=np.int64), error_steps(H, left, right)
    inliers = np.zeros(len(checks), dtype=bool)
    if len(checks) < 4:
        return inliers
    members = np.stack([rng.choice(len(checks), size=4, replace=False) for _ in range(sets)])
    weight, _ = rule_base().evaluate(checks[members].min(axis=1), errors[members].max(axis=1))
    inliers[members[weight > 0]] = True
    return inliers
