from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.geometry.fuzzy_ransac import decide
from tests.skymosaic.thesis.reference.fuzzy_ransac import decide_in_sets_of_four

SHIFT = np.array([[1.0, 0, 10], [0, 1, 0], [0, 0, 1]])


def off_by(errors_px: list[Any] | NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matches with the given transfer errors under `SHIFT`."""
    left = np.random.default_rng(0).uniform(0, 400, (len(errors_px), 2))
    return left, left + np.column_stack([10 + np.asarray(errors_px, dtype=float), np.zeros(len(errors_px))])


def test_one_bad_match_spoils_its_four() -> None:
    left, right = off_by([0, 0, 0, 0])
    rng = np.random.default_rng(2)
    assert decide_in_sets_of_four(SHIFT, left, right, [1, 1, 1, 1], rng=rng, sets=1).all()
    assert not decide_in_sets_of_four(SHIFT, left, right, [1, 1, 1, 0], rng=rng, sets=50).any()
    left, right = off_by([0, 0, 0, 5])
    assert not decide_in_sets_of_four(SHIFT, left, right, [1, 1, 1, 1], rng=rng, sets=50).any()


def test_many_fours_find_what_each_match_would_get() -> None:
    rng = np.random.default_rng(3)
    verified, errors_px = rng.random(40) < 0.8, rng.choice([1.0, 9.0], 40, p=(0.8, 0.2))
    left, right = off_by(errors_px)
    alone = decide(SHIFT, left, right, verified).inliers
    few, many = (decide_in_sets_of_four(SHIFT, left, right, verified, rng=rng, sets=n) for n in (10, 2000))
    np.testing.assert_array_equal(many, alone)
    assert not (few & ~alone).any()
    assert few.sum() < alone.sum()


@pytest.mark.parametrize("count", [0, 3])
def test_fewer_than_four_matches_give_no_four(count: int) -> None:
    left, right = off_by([0] * count)
    assert decide(SHIFT, left, right, np.ones(count, dtype=bool)).inliers.sum() == count
    together = decide_in_sets_of_four(SHIFT, left, right, np.ones(count), rng=np.random.default_rng(4))
    assert together.shape == (count,)
    assert not together.any()
