from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from skymosaic.geometry.fuzzy_ransac import INLIER_RULES, decide, rule_base

SHIFT = np.array([[1.0, 0, 10], [0, 1, 0], [0, 0, 1]])


def off_by(errors_px: list[float | int] | NDArray[Any]) -> tuple[Array, Array]:
    """Matches with the given transfer errors under `SHIFT`."""
    left = np.random.default_rng(0).uniform(0, 400, (len(errors_px), 2))
    return left, left + np.column_stack([10 + np.asarray(errors_px, dtype=float), np.zeros(len(errors_px))])


def test_the_six_rules() -> None:
    # Table III-3: verified or not, against an error less than, equal to, more than 4 px.
    verified = [True, True, True, False, False, False]
    left, right = off_by([3.9, 4, 4.1, 3.9, 4, 4.1])
    decision = decide(SHIFT, left, right, verified)
    np.testing.assert_array_equal(decision.rule, range(6))
    np.testing.assert_array_equal(decision.inliers, [True, True, False, False, False, False])


def test_per_match_decision_is_the_conjunction_of_both_checks() -> None:
    rng = np.random.default_rng(1)
    errors_px = rng.integers(0, 129, 500) / 16
    verified = rng.random(500) < 0.7
    decision = decide(SHIFT, *off_by(errors_px), verified)
    np.testing.assert_array_equal(decision.inliers, verified & (errors_px <= 4))


def test_counts_can_be_those_of_table_iv_4_scene_3() -> None:
    # 162 matches, 129 pass the bidirectional check, 148 RANSAC, 116 both: 13 only the first, 32 only the second.
    groups = {(True, 1): 116, (True, 9): 13, (False, 1): 32, (False, 9): 1}
    verified = np.repeat([check for check, _ in groups], list(groups.values()))
    errors_px = np.repeat([error for _, error in groups], list(groups.values()))
    decision = decide(SHIFT, *off_by(errors_px), verified)
    assert len(verified) == 162
    assert np.isin(decision.rule, (0, 1, 2)).sum() == 129
    assert np.isin(decision.rule, (0, 1, 3, 4)).sum() == 148
    assert decision.inliers.sum() == np.isin(decision.rule, INLIER_RULES).sum() == 116


def test_infinite_error_is_an_outlier() -> None:
    to_infinity = np.array([[1.0, 0, 0], [0, 1, 0], [-0.5, 0, 1]])
    decision = decide(to_infinity, [(2, 3)], [(2, 3)], [True])
    assert decision.rule == [2]
    assert not decision.inliers.any()


def test_each_combination_fires_one_rule_fully() -> None:
    system = rule_base()
    checks, errors = (grid.ravel() for grid in np.meshgrid([0, 1], np.arange(200)))
    strengths = system.strengths(checks, errors)
    np.testing.assert_array_equal(np.sort(strengths, axis=1)[:, -2:], [[0, system.strength_one]] * len(checks))
