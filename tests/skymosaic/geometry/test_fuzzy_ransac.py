from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from skymosaic.geometry.fuzzy_ransac import decide

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


def test_infinite_error_is_an_outlier() -> None:
    to_infinity = np.array([[1.0, 0, 0], [0, 1, 0], [-0.5, 0, 1]])
    decision = decide(to_infinity, [(2, 3)], [(2, 3)], [True])
    assert decision.rule == [2]
    assert not decision.inliers.any()
