import numpy as np
import pytest

from golden_model.arrays import Points
from skymosaic.geometry.held_out import clearly_better, held_out_agreement
from skymosaic.geometry.homography import apply

TRUTH = np.array([[1.02, -0.05, 12.0], [0.04, 0.98, -7.0], [2e-5, -1e-5, 1.0]])
OFF = np.array([[1.0, 0, 1.5], [0, 1, -1], [0, 0, 1]]) @ TRUTH


@pytest.fixture
def grid() -> tuple[Points, Points]:
    left = np.stack(np.meshgrid(np.arange(8, 640, 16.0), np.arange(8, 480, 16.0)), axis=-1).reshape(-1, 2)
    return left, apply(TRUTH, left)


def test_every_field_of_points_without_error_counts_one(grid: tuple[Points, Points]) -> None:
    # 10 x 8 fields of 64 px, the last row half as high.
    assert held_out_agreement(OFF, grid, grid) == pytest.approx(80)
    # The judges decide, wherever the fit starts and whatever its own points say.
    left, right = grid
    assert held_out_agreement(OFF, (left, right + 1.0), grid) == pytest.approx(40, rel=0.01)
    assert held_out_agreement(OFF, (left, right + 3.0), grid) == 0


def test_a_crowded_field_has_one_vote(grid: tuple[Points, Points]) -> None:
    left, right = grid
    crowd = np.full((500, 2), [70.0, 70.0])
    judges = np.vstack((left, crowd)), np.vstack((right, apply(TRUTH, crowd) + 9))
    assert 78.9 < held_out_agreement(TRUTH, grid, judges) < 79.1


def test_points_are_judged_by_fits_without_them(grid: tuple[Points, Points]) -> None:
    """A plane that holds in the fields of one colour alone agrees with none of the other's."""
    left, right = grid
    white = np.floor(left / 64).sum(axis=1) % 2 == 0
    moved = right + np.where(white, 0, 50)[:, None]
    assert held_out_agreement(TRUTH, (left, moved), (left, moved)) == 0


def test_a_field_that_no_other_point_predicts_counts_nothing(grid: tuple[Points, Points]) -> None:
    left, right = grid
    alone = (left < 64).all(axis=1)
    assert held_out_agreement(TRUTH, (left[alone], right[alone]), (left[alone], right[alone])) == 0


def test_a_gain_within_the_noise_is_none() -> None:
    assert [clearly_better(agreement, 10) for agreement in (9, 10.4, 10.6)] == [False, False, True]
