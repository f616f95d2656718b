from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.geometry.homography import DegenerateError, apply, dlt, estimate, rescale

PROJECTIVE = np.array([[0.9, 0.2, 30.0], [-0.15, 1.1, -20.0], [1e-4, -5e-5, 1.0]])
SIMILARITY = np.array([[1.2, -0.5, 7.0], [0.5, 1.2, -3.0], [0.0, 0.0, 1.0]])
ISOMETRY = np.array([[0.6, -0.8, 5.0], [0.8, 0.6, 9.0], [0.0, 0.0, 1.0]])
AFFINE = np.array([[1.1, 0.3, 4.0], [-0.2, 0.7, 8.0], [0.0, 0.0, 1.0]])


def scattered(count: int, seed: int) -> NDArray[np.float64]:
    return np.random.default_rng(seed).uniform(0, 640, (count, 2))


def test_apply_divides_by_the_third_coordinate() -> None:
    H = np.array([[2.0, 0, 1], [0, 1, 3], [0.5, 0, 1]])
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    np.testing.assert_allclose(apply(H, square), [(1, 3), (2, 2), (2, 8 / 3), (1, 4)])
    assert np.isinf(apply(H, (-2, 0))).all()


def test_scaled_refuses_an_origin_at_infinity() -> None:
    np.testing.assert_allclose(rescale(-3 * PROJECTIVE), PROJECTIVE)
    with pytest.raises(DegenerateError, match="infinity"):
        rescale(np.fliplr(np.eye(3)))
    for element, bad in (((0, 1), np.nan), ((1, 0), np.inf), ((2, 2), 1e-15)):
        changed = np.eye(3)
        changed[element] = bad
        with pytest.raises(DegenerateError, match="infinity"):
            rescale(changed)
    assert rescale(np.diag([1, 1, 1e-13]))[0, 0] == pytest.approx(1e13)


@pytest.mark.parametrize("count", [4, 5, 60])
def test_exact_pairs_give_the_exact_homography(count: int) -> None:
    left = scattered(count, seed=count)
    H = dlt(left, apply(PROJECTIVE, left))
    np.testing.assert_allclose(H, PROJECTIVE, rtol=1e-9)


def test_four_pairs_agree_with_opencv() -> None:
    left, right = [(0, 0), (639, 0), (639, 479), (0, 479)], [(12, 7), (600, 33), (652, 470), (-8, 431)]
    reference = cv2.getPerspectiveTransform(np.array(left, np.float32), np.array(right, np.float32))
    np.testing.assert_allclose(dlt(left, right), reference, rtol=1e-9, atol=1e-12)


def test_dlt_minimises_the_algebraic_error() -> None:
    # An independent solver on the raw rows, normalised by hand: the eigenvector of the smallest eigenvalue.
    left = scattered(40, seed=3) / 320 - 1
    right = apply(np.array([[0.9, 0.1, 0.2], [-0.1, 1.0, 0], [0.05, 0.02, 1]]), left)
    right += np.random.default_rng(4).normal(0, 0.02, left.shape)

    def similarity(points: Any) -> Any:
        scale = np.sqrt(2) / np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
        return np.array([[scale, 0, 0], [0, scale, 0], [0, 0, 1]]) @ np.array(
            [[1, 0, -points[:, 0].mean()], [0, 1, -points[:, 1].mean()], [0, 0, 1]]
        )

    to_left, to_right = similarity(left), similarity(right)
    x, y = apply(to_left, left), apply(to_right, right)
    homogeneous = np.column_stack([x, np.ones(40)])
    zeros = np.zeros((40, 3))
    A = np.vstack(
        [
            np.hstack([zeros, -homogeneous, y[:, 1:] * homogeneous]),
            np.hstack([homogeneous, zeros, -y[:, :1] * homogeneous]),
        ]
    )
    h = np.linalg.eigh(A.T @ A)[1][:, 0].reshape(3, 3)
    np.testing.assert_allclose(dlt(left, right), rescale(np.linalg.inv(to_right) @ h @ to_left), atol=1e-9)


@pytest.mark.parametrize(
    ("model", "truth", "count"),
    [("isometry", ISOMETRY, 2), ("similarity", SIMILARITY, 2), ("affine", AFFINE, 3), ("projective", PROJECTIVE, 4)],
)
def test_each_model_recovers_its_own_transformation(model: str, truth: NDArray[np.float64], count: int) -> None:
    left = scattered(count, seed=5)
    np.testing.assert_allclose(estimate(left, apply(truth, left), model=model), truth, atol=1e-9)


def test_models_minimise_the_transfer_error_within_their_freedom() -> None:
    left = scattered(50, seed=6)
    right = apply(AFFINE, left) + np.random.default_rng(7).normal(0, 2, left.shape)
    homogeneous = np.column_stack([left, np.ones(50)])
    affine = np.linalg.lstsq(homogeneous, right, rcond=None)[0].T
    np.testing.assert_allclose(estimate(left, right, model="affine")[:2], affine, atol=1e-9)

    def cost(model: Any, turn: float = 0.0, growth: float = 1.0) -> Any:
        H = estimate(left, right, model=model)
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
        linear = estimate(left, right, model="isometry")[:2, :2]
        np.testing.assert_allclose(linear @ linear.T, np.eye(2), atol=1e-12)
        assert np.linalg.det(linear) == pytest.approx(1)


LINE = np.column_stack([np.arange(10.0), 2 * np.arange(10.0)])
THREE_ON_A_LINE = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1]])


@pytest.mark.parametrize(
    ("model", "points"),
    [
        ("projective", scattered(3, seed=0)),
        ("projective", LINE),
        ("projective", THREE_ON_A_LINE),
        ("projective", np.ones((8, 2))),
        ("affine", scattered(2, seed=0)),
        ("affine", LINE),
        ("similarity", np.zeros((1, 2))),
        ("similarity", np.ones((5, 2))),
        ("isometry", np.ones((5, 2))),
    ],
)
def test_degenerate_points_are_refused(model: str, points: NDArray[np.float64]) -> None:
    with pytest.raises(DegenerateError):
        estimate(points, apply(ISOMETRY, points), model=model)


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (np.zeros((5, 3)), np.zeros((5, 3)), "point pairs have shapes"),
        (np.zeros((5, 2)), np.zeros((4, 2)), "point pairs have shapes"),
        (np.zeros(2), np.zeros(2), "point pairs have shapes"),
        (np.zeros((5, 2, 2)), np.zeros((5, 2, 2)), "point pairs have shapes"),
        (np.full((5, 2), np.nan), np.zeros((5, 2)), "point pairs must be finite"),
        (np.zeros((5, 2)), np.full((5, 2), np.inf), "point pairs must be finite"),
    ],
)
def test_malformed_pairs_are_refused(left: NDArray[np.float64], right: NDArray[np.float64], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        estimate(left, right)


def test_unknown_model_names_the_valid_ones() -> None:
    with pytest.raises(ValueError, match=r"'conic'.*affine"):
        estimate(np.zeros((4, 2)), np.zeros((4, 2)), model="conic")
