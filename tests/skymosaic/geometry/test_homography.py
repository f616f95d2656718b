from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array
from skymosaic.geometry.homography import DegenerateError, apply, dlt, estimate_similarity, rescale

PROJECTIVE = np.array([[0.9, 0.2, 30.0], [-0.15, 1.1, -20.0], [1e-4, -5e-5, 1.0]])
ISOMETRY = np.array([[0.6, -0.8, 5.0], [0.8, 0.6, 9.0], [0.0, 0.0, 1.0]])


def scattered(count: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(0, 640, (count, 2))


def test_homographies_are_applied_and_rescaled_up_to_infinity() -> None:
    H = np.array([[2.0, 0, 1], [0, 1, 3], [0.5, 0, 1]])
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    np.testing.assert_allclose(apply(H, square), [(1, 3), (2, 2), (2, 8 / 3), (1, 4)])
    assert np.isinf(apply(H, (-2, 0))).all()
    np.testing.assert_allclose(rescale(-3 * PROJECTIVE), PROJECTIVE)
    with pytest.raises(DegenerateError, match="infinity"):
        rescale(np.fliplr(np.eye(3)))
    for element, bad in (((0, 1), np.nan), ((1, 0), np.inf), ((2, 2), 1e-15)):
        changed = np.eye(3)
        changed[element] = bad
        with pytest.raises(DegenerateError, match="infinity"):
            rescale(changed)
    assert rescale(np.diag([1, 1, 1e-13]))[0, 0] == pytest.approx(1e13)


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


LINE = np.column_stack([np.arange(10.0), 2 * np.arange(10.0)])
THREE_ON_A_LINE = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1]])


@pytest.mark.parametrize("points", [scattered(3, seed=0), LINE, THREE_ON_A_LINE, np.ones((8, 2))])
def test_points_that_determine_no_homography_are_refused(points: Array) -> None:
    with pytest.raises(DegenerateError):
        dlt(points, apply(ISOMETRY, points))


@pytest.mark.parametrize("points", [np.zeros((1, 2)), np.ones((5, 2))])
def test_points_that_determine_no_similarity_are_refused(points: Array) -> None:
    with pytest.raises(DegenerateError):
        estimate_similarity(points, apply(ISOMETRY, points))
