import numpy as np
import pytest

from skymosaic.geometry import fuzzy_ransac
from skymosaic.geometry.estimators import ESTIMATORS, FUZZY_RANSAC, estimate, estimate_by_opencv, fuzzy
from skymosaic.geometry.homography import apply

SIZE = (600, 600)
TRUTH = np.array([[1.05, 0.08, -20], [-0.06, 0.97, 35], [6e-5, -4e-5, 1]])


def matches(good: int = 120, bad: int = 60, noise_px: float = 0.3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    left = rng.uniform(0, 600, (good + bad, 2))
    right = apply(TRUTH, left) + rng.normal(0, noise_px, left.shape)
    right[good:] = rng.uniform(0, 600, (bad, 2))
    return left, right, np.arange(good + bad) < good


def estimated(
    name: str, left: np.ndarray, right: np.ndarray, verified: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray]:
    """All with one weight."""
    return estimate(name, left, right, np.ones(len(left)), verified, size=SIZE, rng=np.random.default_rng(0))


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_finds_the_homography_among_wrong_matches(name: str) -> None:
    left, right, good = matches()
    verified = np.ones(len(left), dtype=bool)
    H, inliers = estimated(name, left, right, verified)
    corners = np.array([[0, 0], [600, 0], [0, 600], [600, 600]])
    assert H is not None
    assert np.linalg.norm(apply(H, corners) - apply(TRUTH, corners), axis=1).max() < 1.0
    assert inliers[good].mean() > 0.95
    assert inliers[~good].mean() < 0.05


@pytest.mark.parametrize("name", ESTIMATORS)
def test_unverified_matches_are_not_inliers(name: str) -> None:
    left, right, good = matches()
    verified = good & (np.arange(len(left)) % 2 == 0)
    _, inliers = estimated(name, left, right, verified)
    assert inliers.any()
    assert not (inliers & ~verified).any()


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("count", [0, 3, 11, 12])
def test_fewer_than_twelve_matches_are_not_accepted(name: str, count: int) -> None:
    left, right, _ = matches(good=count, bad=0, noise_px=0.05)
    H, inliers = estimated(name, left, right, np.ones(count, dtype=bool))
    assert (H is None) == (count < 12)
    assert inliers.shape == (count,)


def test_fuzzy_ransac_accepts_what_its_rules_accept() -> None:
    left, right, _ = matches()
    verified = np.arange(len(left)) % 3 > 0
    H, inliers = estimated(FUZZY_RANSAC, left, right, verified)
    _, decision = fuzzy(left, right, verified)
    candidate = estimate_by_opencv("ransac", left, right)
    assert candidate is not None
    expected = fuzzy_ransac.decide(candidate, left, right, verified)
    np.testing.assert_array_equal(decision.rule, expected.rule)
    np.testing.assert_array_equal(inliers, np.isin(expected.rule, fuzzy_ransac.INLIER_RULES))
    assert H is not None
