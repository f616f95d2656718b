import cv2
import numpy as np
import pytest

from skymosaic.geometry.homography import DegenerateError, apply
from tests.skymosaic.thesis.reference.least_squares import estimate_inhomogeneous

PROJECTIVE = np.array([[0.9, 0.2, 30.0], [-0.15, 1.1, -20.0], [1e-4, -5e-5, 1.0]])


@pytest.mark.parametrize("count", [4, 5, 60])
def test_exact_pairs_give_the_exact_homography(count: int) -> None:
    left = np.random.default_rng(count).uniform(0, 640, (count, 2))
    np.testing.assert_allclose(estimate_inhomogeneous(left, apply(PROJECTIVE, left)), PROJECTIVE, rtol=1e-9)


def test_four_pairs_agree_with_opencv() -> None:
    left, right = [(0, 0), (639, 0), (639, 479), (0, 479)], [(12, 7), (600, 33), (652, 470), (-8, 431)]
    reference = cv2.getPerspectiveTransform(np.array(left, np.float32), np.array(right, np.float32))
    np.testing.assert_allclose(estimate_inhomogeneous(left, right), reference, rtol=1e-9, atol=1e-12)


def test_inhomogeneous_is_the_normal_equations_solution() -> None:
    left = np.random.default_rng(1).uniform(0, 640, (30, 2))
    # Centred, with mean distance sqrt(2), so that the thesis's h33 = 1 is fixed in the same coordinates.
    left = (left - left.mean(axis=0)) / np.linalg.norm(left - left.mean(axis=0), axis=1).mean() * np.sqrt(2)
    right = left + np.random.default_rng(2).normal(0, 0.01, left.shape)
    right = (right - right.mean(axis=0)) / np.linalg.norm(right - right.mean(axis=0), axis=1).mean() * np.sqrt(2)
    rows, target = [], []
    for (x, y), (u, v) in zip(left, right, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        target += [u, v]
    A, b = np.array(rows), np.array(target)
    h = np.linalg.inv(A.T @ A) @ A.T @ b
    np.testing.assert_allclose(estimate_inhomogeneous(left, right).ravel()[:8], h, atol=1e-12)


def test_inhomogeneous_refuses_collinear_points() -> None:
    line = np.column_stack([np.arange(10.0), 2 * np.arange(10.0)])
    with pytest.raises(DegenerateError):
        estimate_inhomogeneous(line, line)
