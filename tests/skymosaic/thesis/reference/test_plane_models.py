from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.geometry.homography import DegenerateError, apply, dlt, estimate_similarity
from tests.skymosaic.geometry.test_homography import ISOMETRY, PROJECTIVE, scattered
from tests.skymosaic.thesis.reference.plane_models import estimate_affine, estimate_isometry

SIMILARITY = np.array([[1.2, -0.5, 7.0], [0.5, 1.2, -3.0], [0.0, 0.0, 1.0]])
AFFINE = np.array([[1.1, 0.3, 4.0], [-0.2, 0.7, 8.0], [0.0, 0.0, 1.0]])
MODELS = {
    "isometry": estimate_isometry,
    "similarity": estimate_similarity,
    "affine": estimate_affine,
    "projective": dlt,
}


@pytest.mark.parametrize(
    ("model", "truth", "count"),
    [("isometry", ISOMETRY, 2), ("similarity", SIMILARITY, 2), ("affine", AFFINE, 3), ("projective", PROJECTIVE, 4)],
)
def test_each_model_recovers_its_own_transformation(model: str, truth: NDArray[np.float64], count: int) -> None:
    left = scattered(count, seed=5)
    np.testing.assert_allclose(MODELS[model](left, apply(truth, left)), truth, atol=1e-9)


def test_models_minimise_the_transfer_error_within_their_freedom() -> None:
    left = scattered(50, seed=6)
    right = apply(AFFINE, left) + np.random.default_rng(7).normal(0, 2, left.shape)
    homogeneous = np.column_stack([left, np.ones(50)])
    affine = np.linalg.lstsq(homogeneous, right, rcond=None)[0].T
    np.testing.assert_allclose(estimate_affine(left, right)[:2], affine, atol=1e-9)

    def cost(model: Any, turn: float = 0.0, growth: float = 1.0) -> Any:
        H = MODELS[model](left, right)
        centre = left.mean(axis=0)
        turned = growth * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        return np.sum((apply(H, centre + (left - centre) @ turned.T) - right) ** 2)

    assert cost("affine") < cost("similarity") < cost("isometry")
    for change in ({"turn": 0.01}, {"turn": -0.01}, {"growth": 1.01}, {"growth": 0.99}):
        assert cost("similarity") < cost("similarity", **change)
    assert cost("isometry") < min(cost("isometry", turn=0.01), cost("isometry", turn=-0.01))


def test_isometry_keeps_lengths_and_never_mirrors() -> None:
    left = scattered(20, seed=8)
    for right in (apply(SIMILARITY, left), left * (1, -1)):
        linear = estimate_isometry(left, right)[:2, :2]
        np.testing.assert_allclose(linear @ linear.T, np.eye(2), atol=1e-12)
        assert np.linalg.det(linear) == pytest.approx(1)


@pytest.mark.parametrize(
    ("model", "points"),
    [
        ("affine", scattered(2, seed=0)),
        ("affine", np.column_stack([np.arange(10.0), 2 * np.arange(10.0)])),
        ("isometry", np.ones((5, 2))),
    ],
)
def test_degenerate_points_are_refused(model: str, points: NDArray[np.float64]) -> None:
    with pytest.raises(DegenerateError):
        MODELS[model](points, apply(ISOMETRY, points))
