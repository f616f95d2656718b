from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from skymosaic.geometry.homography import DegenerateError, apply, dlt
from tests.skymosaic.thesis.reference.refinement import (
    Residuals,
    refine,
    reprojection,
    sampson,
    squared_errors,
    symmetric,
    transfer,
)

ERRORS = [transfer, symmetric, reprojection, sampson]
TRUTH = np.array([[0.9, 0.2, 30.0], [-0.15, 1.1, -20.0], [1e-4, -5e-5, 1.0]])


def noisy_pairs(
    count: int, sigma_px: float, seed: int, truth: NDArray[np.float64] = TRUTH
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Noise in both images."""
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, 640, (count, 2))
    right = apply(truth, left) + rng.normal(0, sigma_px, left.shape)
    return left + rng.normal(0, sigma_px, left.shape), right


def test_errors_of_a_shift_by_hand() -> None:
    # (3, 4) off under a pure shift: 25 in one image, 25 in each of both; half the way in each is the nearest.
    shift = np.array([[1.0, 0, 10], [0, 1, 0], [0, 0, 1]])
    found = [squared_errors(shift, [(5, 5)], [(18, 9)], error)[0] for error in ERRORS]
    assert found == pytest.approx([25, 50, 12.5, 12.5])


def test_errors_of_a_zoom_by_hand() -> None:
    # Under a zoom of 2 an offset of 5 right pixels is 2.5 left ones; the nearest pair is 25 / (1 + 2²) away.
    zoom = np.diag([2.0, 2, 1])
    found = [squared_errors(zoom, [(1, 1)], [(5, 6)], error)[0] for error in ERRORS]
    assert found == pytest.approx([25, 31.25, 5, 5])


def test_reprojection_error_against_direct_minimisation() -> None:
    left, right = noisy_pairs(5, 8.0, seed=2)
    for x, y, error in zip(left, right, squared_errors(TRUTH, left, right, reprojection), strict=True):
        nearest = minimize(
            lambda z, x=x, y=y: np.sum((z - x) ** 2) + np.sum((apply(TRUTH, z) - y) ** 2), x, method="BFGS", tol=1e-9
        )
        assert error == pytest.approx(nearest.fun, rel=1e-6)


@pytest.mark.parametrize("error", ERRORS)
def test_refine_reaches_a_minimum_of_its_own_error(error: Residuals) -> None:
    left, right = noisy_pairs(40, 1.0, seed=3)
    start = dlt(left, right)
    refined = refine(start, left, right, error)

    def cost(h: Any) -> Any:
        return squared_errors(np.append(h, 1).reshape(3, 3), left, right, error).sum()

    h = refined.ravel()[:8]
    assert cost(h) < cost(start.ravel()[:8])
    for direction in np.eye(8):
        step = direction * np.abs(h) * 1e-3
        assert cost(h) < min(cost(h + step), cost(h - step))


def test_reprojection_refinement_against_the_full_bundle() -> None:
    # Independent: all 8 + 2N unknowns at once with numeric derivatives, in coordinates around 1.
    left, right = (points / 320 - 1 for points in noisy_pairs(12, 2.0, seed=4))

    def residuals(unknowns: Any) -> Any:
        exact = unknowns[8:].reshape(-1, 2)
        return np.concatenate([exact - left, apply(np.append(unknowns[:8], 1).reshape(3, 3), exact) - right]).ravel()

    start = dlt(left, right)
    bundle = least_squares(residuals, np.append(start.ravel()[:8], left), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    refined = refine(start, left, right, reprojection)
    np.testing.assert_allclose(refined.ravel()[:8], bundle.x[:8], atol=1e-6)
    assert squared_errors(refined, left, right, reprojection).sum() == pytest.approx(2 * bundle.cost, rel=1e-9)


def mean_distances(truth: NDArray[np.float64], count: int, *errors: Residuals | None) -> list[float]:
    """Mean over seeds 0 to 39 of the mean distance over a grid, for noise of 1 px in both images; None: of the DLT."""
    grid = np.stack(np.meshgrid(np.linspace(0, 640, 9), np.linspace(0, 640, 9)), axis=-1).reshape(-1, 2)
    distance = np.zeros(len(errors))
    for seed in range(40):
        left, right = noisy_pairs(count, 1.0, seed, truth)
        start = dlt(left, right)
        estimates = [refine(start, left, right, error) if error else start for error in errors]
        distance += [np.linalg.norm(apply(H, grid) - apply(truth, grid), axis=1).mean() / 40 for H in estimates]
    return distance.tolist()


def test_better_models_of_the_noise_are_closer_to_the_truth() -> None:
    truth = np.array([[0.5, 0.1, 20], [-0.1, 0.5, 10], [-6e-4, -4e-4, 1]])
    by_reprojection, by_symmetric, by_dlt = mean_distances(truth, 12, reprojection, symmetric, None)
    assert by_reprojection < by_symmetric < by_dlt


def test_only_reprojection_and_sampson_stand_strong_perspective() -> None:
    # Points near the horizon have large errors in one image, which the symmetric error trusts all the same.
    truth = np.array([[1, 0.1, 20], [-0.1, 1, 10], [3e-3, 1e-3, 1]])
    by_reprojection, by_sampson, *others = mean_distances(truth, 16, reprojection, sampson, symmetric, None)
    assert by_reprojection < 0.97 * min(others)
    assert by_sampson == pytest.approx(by_reprojection, rel=0.01)


def test_bad_input_is_refused() -> None:
    left, right = noisy_pairs(10, 1.0, seed=9)
    with pytest.raises(DegenerateError, match="at least 4"):
        refine(TRUTH, left[:3], right[:3], symmetric)
    with pytest.raises(DegenerateError, match="coincide"):
        refine(TRUTH, np.ones((6, 2)), np.ones((6, 2)), symmetric)
