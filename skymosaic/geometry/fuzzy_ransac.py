"""The thesis's fuzzy RANSAC: six rules decide which matches are inliers of a homography (Table III-3).

A match is an inlier if it passed the bidirectional check and its error is less than or equal to tau. The counts of
Table IV-4 come out only if every match is decided on its own, as `decide` does. The thesis's text instead decides
four random matches together, see `tests/skymosaic/thesis/reference/fuzzy_ransac.py`.
"""

import itertools
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from golden_model.arrays import Array, Mask
from golden_model.formats import POSITION
from golden_model.fuzzy.sugeno import ONE, Rule, SugenoSystem, Variable
from skymosaic.geometry.homography import transfer_error

TOLERANCE_PX = 4.0
"""The thesis's tau."""
INLIER_RULES = (0, 1)
NEAR_RULES = (0, 1, 3, 4)
"""Rules for an error of at most tau: the matches that RANSAC alone would accept."""


@dataclass(frozen=True)
class Decision:
    """Result of the six rules for each match."""

    rule: NDArray[np.uint8]
    """(N,): the rule that fired: 0, 1, 2 for a verified match whose error is less than, equal to, more than tau; 3, 4,
    5 for a match that is not verified."""
    inliers: Mask
    """(N,): whether that rule accepts the match (rules 0 and 1)."""


@lru_cache
def rule_base() -> SugenoSystem:
    """Build the six rules over two inputs: the bidirectional check (0 or 1) and the error in 1/16 px."""
    tau = round(TOLERANCE_PX * POSITION.one)
    # Tables end one step beyond tau, because larger inputs saturate.
    steps = np.arange(tau + 2)
    check = {"verified": np.array([0, ONE]), "not verified": np.array([ONE, 0])}
    error = {"less": steps < tau, "equal": steps == tau, "more": steps > tau}
    combinations = itertools.product(check, error)
    return SugenoSystem(
        "fuzzy RANSAC",
        inputs=(
            Variable("bidirectional check", check),
            Variable("error", {name: ONE * table.astype(np.int64) for name, table in error.items()}),
        ),
        rules=tuple(Rule(sets, 1.0 if index in INLIER_RULES else 0.0) for index, sets in enumerate(combinations)),
        conjunction="minimum",
    )


def decide(H: Array, left: ArrayLike, right: ArrayLike, verified: ArrayLike) -> Decision:
    """Apply the rules to each match on its own.

    Parameters
    ----------
    H : (3, 3) float64 ndarray
        Maps left to right; the thesis takes it from RANSAC over all matches.
    left, right : (N, 2) array_like
        Matched points, px.
    verified : (N,) array_like of bool
        Whether the match passed the bidirectional check.
    """
    weight, rule = rule_base().evaluate(np.asarray(verified, dtype=np.int64), error_steps(H, left, right))
    return Decision(rule, weight > 0)


def error_steps(H: Array, left: ArrayLike, right: ArrayLike) -> NDArray[np.int64]:
    """Transfer errors in steps of 1/16 px, limited to twice tau; infinite errors are at the limit.

    The step is the resolution of feature positions, so "equal to tau" means within half a step of it.
    """
    capped = np.minimum(np.nan_to_num(transfer_error(H, left, right), nan=np.inf), 2 * TOLERANCE_PX)
    return np.asarray(np.rint(capped * POSITION.one), dtype=np.int64)
