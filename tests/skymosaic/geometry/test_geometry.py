"""Which homographies are accepted, how sure they are, and how they are refined and compared."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array, Points
from skymosaic.geometry import acceptance
from skymosaic.geometry.held_out import clearly_better, held_out_agreement
from skymosaic.geometry.homography import apply
from skymosaic.geometry.model_selection import fit, fit_similarity
from skymosaic.geometry.uncertainty import assess_fit

SIZE = (640, 480)
SHIFT = np.array([[1.0, 0, -320], [0, 1, 0], [0, 0, 1]])


def test_coinciding_matches_count_once_and_overlaps_are_the_common_part() -> None:
    points = np.array([[10.0, 10], [10.5, 10.2], [100, 100], [101, 101]])
    assert acceptance.count_places(points, points) == 2
    assert acceptance.count_places(points, np.full((4, 2), 50.0)) == 1
    assert acceptance.count_places(points[:0], points[:0]) == 0
    # A column, and a row: neither coordinate alone tells places apart.
    line = np.column_stack([np.full(5, 8.0), np.arange(5) * 4.0])
    assert acceptance.count_places(line, line) == acceptance.count_places(line[:, ::-1], line) == 5
    assert acceptance.hull_area(acceptance.overlap(SHIFT, SIZE, SIZE)) == pytest.approx(320 * 480)
    assert acceptance.hull_area(acceptance.overlap(np.eye(3), SIZE, SIZE)) == pytest.approx(640 * 480)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_overlap_ends_at_the_horizon_of_either_image(sign: int) -> None:
    tilted = np.array([[1.0, 0, 0], [0, 1, 0], [0.002, -0.004, 1]]) @ SHIFT
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    for homography in (tilted, np.linalg.inv(tilted)):
        u, v, w = np.moveaxis(np.stack((x, y, np.ones_like(x)), axis=-1) @ homography.T, -1, 0)
        assert w.min() < 0 < w.max()
        low, high = -0.5 * w, (np.array(SIZE) - 0.5)[:, None, None] * w
        # Beyond the horizon, where w < 0, pixels come from behind the camera.
        shown = (w > 0) & (u >= low) & (v >= low) & (u <= high[0]) & (v <= high[1])
        mask = acceptance.overlap_mask(sign * homography, SIZE, SIZE)
        assert 1000 < np.count_nonzero(shown) == pytest.approx(np.count_nonzero(mask), rel=0.02)
        assert np.count_nonzero(shown != (mask == 255)) < 0.02 * np.count_nonzero(shown)
        area = acceptance.hull_area(acceptance.overlap(sign * homography, SIZE, SIZE))
        assert area == pytest.approx(np.count_nonzero(shown), rel=0.02)


def square(side_px: int, corner: tuple[float, float] = (330.0, 10.0)) -> Array:
    return np.array([[0.0, 0], [side_px, 0], [side_px, side_px], [0, side_px]]) + corner


@pytest.mark.parametrize(("height_px", "enough"), [(119, False), (120, True)])
def test_inliers_must_cover_a_tenth_of_the_overlap(height_px: int, enough: bool) -> None:
    left = square(128) * (1, height_px / 128)
    assert acceptance.spread_enough(SHIFT, left, left - [320, 0], SIZE, SIZE) is enough
    assert acceptance.hull_area(left[:3]) == 128 * height_px / 2
    assert acceptance.hull_share(SHIFT, 9 * left, SIZE, SIZE) == 1


def test_eight_percent_of_the_smaller_image_also_suffice() -> None:
    """A small photograph inside a large one: its own pixels count."""
    small, enlarge = (100, 100), np.diag([4.0, 4.0, 1.0])
    left = square(20, (0.0, 0.0)) * (2, 1)
    right = 4 * left
    assert acceptance.hull_share(enlarge, left, small, SIZE) < acceptance.MIN_SHARE_OF_OVERLAP
    assert acceptance.spread_enough(enlarge, left, right, small, SIZE)
    assert not acceptance.spread_enough(enlarge, left * (0.99, 1), right * (0.99, 1), small, SIZE)
    assert acceptance.spread_enough(np.linalg.inv(enlarge), right, left, SIZE, small)


TRUTH = np.array([[0.98, -0.05, 20], [0.04, 1.01, -15], [1e-5, -2e-5, 1]])


def points(
    count: int, rng: np.random.Generator, low: Any = (0, 0), high: tuple[int, int] = SIZE
) -> tuple[Array, Array]:
    left = rng.uniform(low, high, (count, 2))
    return left, apply(TRUTH, left)


@pytest.mark.parametrize(
    ("count", "homography", "expected"),
    [
        (7, TRUTH, (0, 12, 0.26095, 7)),
        (8, TRUTH, (1 / 3, 2.07568, 0.37123, 8)),
        (40, TRUTH, (1, 1.27130, 0.75254, 39)),
        (60, TRUTH @ np.diag([1, 1, 1000]), (0, 12, 0, 0)),
    ],
    ids=["few", "enough", "many", "no overlap"],
)
def test_a_fit_is_measured(count: int, homography: Array, expected: tuple[float, ...]) -> None:
    """Few matches, and an overlap that is none, give the worst values and no error."""
    rng = np.random.default_rng(3)
    left, right = points(count, rng)
    quality = assess_fit(homography, left, right + rng.normal(0, 0.5, left.shape), SIZE, SIZE)
    assert dataclasses.astuple(quality) == pytest.approx(expected, rel=1e-3)


OFF = np.array([[1.0, 0, 1.5], [0, 1, -1], [0, 0, 1]]) @ TRUTH


@pytest.fixture
def grid() -> tuple[Points, Points]:
    left = np.stack(np.meshgrid(np.arange(8, 640, 16.0), np.arange(8, 480, 16.0)), axis=-1).reshape(-1, 2)
    return left, apply(TRUTH, left)


def test_fields_of_held_out_points_have_a_vote_each(grid: tuple[Points, Points]) -> None:
    # 10 x 8 fields of 64 px, the last row half as high.
    assert held_out_agreement(OFF, grid, grid) == pytest.approx(80)
    # The judges decide, wherever the fit starts and whatever its own points say.
    left, right = grid
    assert held_out_agreement(OFF, (left, right + 1.0), grid) == pytest.approx(40, rel=0.01)
    assert held_out_agreement(OFF, (left, right + 3.0), grid) == 0
    crowd = np.full((500, 2), [70.0, 70.0])
    judges = np.vstack((left, crowd)), np.vstack((right, apply(TRUTH, crowd) + 9))
    assert 78.9 < held_out_agreement(TRUTH, grid, judges) < 79.1
    # A plane that holds in the fields of one colour alone agrees with none of the other's.
    white = np.floor(left / 64).sum(axis=1) % 2 == 0
    moved = right + np.where(white, 0, 50)[:, None]
    assert held_out_agreement(TRUTH, (left, moved), (left, moved)) == 0
    alone = (left < 64).all(axis=1)
    assert held_out_agreement(TRUTH, (left[alone], right[alone]), (left[alone], right[alone])) == 0


def test_a_gain_within_the_noise_is_none() -> None:
    assert [clearly_better(agreement, 10) for agreement in (9, 10.4, 10.6)] == [False, False, True]


SIMILAR = np.array([[0.9, -0.3, 20.0], [0.3, 0.9, -10.0], [0, 0, 1]])
TILTED = np.array([[0.9, -0.3, 20.0], [0.3, 0.9, -10.0], [6e-4, -9e-4, 1]])


def matches(
    truth: np.ndarray, right_ones: int, wrong_ones: int, seed: int = 0, noise_px: float = 0.3
) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, 250, (right_ones + wrong_ones, 2))
    right = apply(truth, left) + rng.normal(0, noise_px, left.shape)
    right[right_ones:] = rng.uniform(0, 250, (wrong_ones, 2))
    return left, right, np.ones(len(left))


def error_px(result: np.ndarray, truth: np.ndarray) -> float:
    corners = np.array([[0, 0], [250, 0], [250, 250], [0, 250]], dtype=np.float64)
    return float(np.linalg.norm(apply(result, corners) - apply(truth, corners), axis=1).max())


@pytest.mark.parametrize("seed", range(5))
def test_eight_right_matches_among_thirty_wrong_ones_are_enough(seed: int) -> None:
    result = fit_similarity(*matches(SIMILAR, 8, 30, seed), fewest=6)
    assert result.inliers >= 8
    assert error_px(result.matrix, SIMILAR) < 1.5


@pytest.mark.parametrize("seed", range(20))
def test_chance_matches_are_refused(seed: int) -> None:
    assert fit_similarity(*matches(SIMILAR, 0, 40, seed), fewest=6) is None


def test_enough_matches_decide_between_similarity_and_homography() -> None:
    for truth, model in ((SIMILAR, "similarity"), (TILTED, "projective")):
        result = fit(*matches(truth, 60, 20), fewest=6, rng=np.random.default_rng(1))
        assert result.model == model
        assert error_px(result.matrix, truth) < 1.0
    result = fit(*matches(TILTED, 9, 0), fewest=4, rng=np.random.default_rng(1))
    assert result is None or result.model == "similarity"
    assert fit(*matches(TILTED, 30, 0), fewest=31, rng=np.random.default_rng(1)) is None
    enough = fit(*matches(TILTED, 30, 0), fewest=30, rng=np.random.default_rng(1))
    assert enough is not None
    assert (enough.model, enough.inliers) == ("projective", 30)


@pytest.mark.parametrize(("apart_px", "fewest", "found"), [(11, 2, True), (10, 2, False), (11, 3, False)])
def test_two_matches_that_are_far_enough_apart_determine_a_similarity(apart_px: int, fewest: int, found: bool) -> None:
    left = np.array([[5.0, 7], [5, 7 + apart_px]])
    result = fit_similarity(left, apply(SIMILAR, left), np.ones(2), fewest=fewest)
    assert (result is not None) == found
    assert result is None or (result.matrix == pytest.approx(SIMILAR) and result[1:] == ("similarity", 2))
