import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.geometry.homography import apply
from skymosaic.geometry.model_selection import fit, fit_similarity

SIMILAR = np.array([[0.9, -0.3, 20.0], [0.3, 0.9, -10.0], [0, 0, 1]])
TILTED = np.array([[0.9, -0.3, 20.0], [0.3, 0.9, -10.0], [6e-4, -9e-4, 1]])


def matches(
    truth: np.ndarray, right_ones: int, wrong_ones: int, seed: int = 0, noise_px: float = 0.3
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
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


def test_the_matches_decide_between_similarity_and_homography() -> None:
    for truth, model in ((SIMILAR, "similarity"), (TILTED, "projective")):
        result = fit(*matches(truth, 60, 20), fewest=6, rng=np.random.default_rng(1))
        assert result.model == model
        assert error_px(result.matrix, truth) < 1.0


def test_few_matches_never_make_a_homography() -> None:
    result = fit(*matches(TILTED, 9, 0), fewest=4, rng=np.random.default_rng(1))
    assert result is None or result.model == "similarity"


def test_as_many_inliers_are_needed_for_either_model() -> None:
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


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_matches_are_refused(count: int) -> None:
    assert fit_similarity(*matches(SIMILAR, count, 0), fewest=1) is None
