from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.geometry.homography import apply, dlt
from skymosaic.geometry.refinement import matrix_of, refine_robustly, transfer
from tests.skymosaic.thesis.reference import refinement as reference

TRUTH = np.array([[0.9, 0.2, 30.0], [-0.15, 1.1, -20.0], [1e-4, -5e-5, 1.0]])


def noisy_pairs(count: int, sigma_px: float, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Noise in both images."""
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, 640, (count, 2))
    right = apply(TRUTH, left) + rng.normal(0, sigma_px, left.shape)
    return left + rng.normal(0, sigma_px, left.shape), right


def test_jacobian_against_finite_differences() -> None:
    # A strongly projective case in coordinates around 1, far from a minimum.
    rng = np.random.default_rng(1)
    x = rng.uniform(-1, 1, (30, 2))
    h = np.array([0.9, 0.2, 0.1, -0.15, 1.1, -0.2, 0.2, -0.1])
    y = apply(matrix_of(h), x) + rng.normal(0, 0.05, x.shape)
    steps = 1e-6 * np.eye(8)
    numeric = np.stack([(transfer(h + d, x, y)[0] - transfer(h - d, x, y)[0]) / 2e-6 for d in steps], axis=-1)
    np.testing.assert_allclose(transfer(h, x, y)[1], numeric, atol=1e-8)


def test_robust_refinement_ignores_outliers() -> None:
    left, right = noisy_pairs(100, 0.3, seed=6)
    clean = reference.refine(dlt(left, right), left, right, reference.transfer)
    right[70:] += np.random.default_rng(7).uniform(20, 200, (30, 2))
    start = clean + np.array([[0, 0, 2.0], [0, 0, -2.0], [0, 0, 0]])
    refined = refine_robustly(start, left, right)
    corners = np.array([(0, 0), (640, 0), (640, 640), (0, 640)])
    assert np.linalg.norm(apply(refined, corners) - apply(TRUTH, corners), axis=1).max() < 0.5


def test_robust_step_follows_the_geman_mcclure_gradient(monkeypatch: pytest.MonkeyPatch) -> None:
    # At the end of many steps of one scale the gradient of the sum of e²/(1 + e²/s²) vanishes.
    monkeypatch.setattr("skymosaic.geometry.refinement.ROBUST_SCALES_PX", (1.5,) * 40)
    left, right = noisy_pairs(60, 1.0, seed=8)
    refined = refine_robustly(dlt(left, right), left, right)

    def loss(h: Any) -> Any:
        squared = reference.squared_errors(np.append(h, 1).reshape(3, 3), left, right, reference.transfer)
        return (squared / (1 + squared / 1.5**2)).sum()

    h = refined.ravel()[:8]
    for direction in np.eye(8):
        step = direction * np.abs(h) * 1e-3
        assert loss(h) < min(loss(h + step), loss(h - step))
