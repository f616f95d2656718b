"""Homographies of four matches against the host's solver in floating point, and which samples are dropped."""

import numpy as np

from golden_model.geometry.estimator import passes, quantise
from golden_model.geometry.floating import Floats
from golden_model.geometry.solving import areas, solve
from skymosaic.geometry.homography import apply, dlt, transfer_error

TRUTH = np.array([[0.9, 0.3, 40.0], [-0.2, 1.1, 90.0], [1e-4, -5e-5, 1.0]])


def samples(count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Positions (count, 4, 2) in 1/16 px."""
    left = np.random.default_rng(seed).integers(0, [640 * 16, 480 * 16], (count, 4, 2))
    right = np.rint(16 * apply(TRUTH, left.reshape(-1, 2) / 16 + 100)).astype(np.int64).reshape(left.shape)
    return left, right


def solved(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hypotheses, and which of them are valid."""
    zero, one = (Floats.from_real(np.full(1, float(value))) for value in (0, 1))
    p, q = (
        [[Floats.from_integers(side[:, k, axis], 16) for axis in range(2)] for k in range(4)] for side in (left, right)
    )
    kept, products = areas(zero, one, (p, q))
    rows = solve(zero, one, (p, q), kept)
    return quantise(rows), np.all([passes(each) for each in products], axis=0)


def test_solutions_are_those_in_floating_point() -> None:
    left, right = samples(400)
    hypotheses, valid = solved(left, right)
    assert valid.mean() > 0.9
    units = np.array([4096.0, 4096, 1])
    for n in np.flatnonzero(valid):
        points = left[n] / 16
        H = hypotheses[n] * units[:, np.newaxis] / units
        assert (H[2, :2] @ points.T + H[2, 2] > 0).all()
        # Truncation to 24 bits moves positions by less than a fifth of their own step.
        assert transfer_error(H, points, right[n] / 16).max() < 1 / 80, n
        assert transfer_error(dlt(points, right[n] / 16), points, apply(H, points)).max() < 1 / 80


def test_turned_triangles_and_small_ones_are_dropped() -> None:
    left, right = samples(6)
    left[:], right[:] = left[0], right[0]
    mirrored, swapped, line, same, small = range(1, 6)
    right[mirrored, :, 0] = 12000 - right[mirrored, :, 0]
    right[swapped, :2] = right[swapped, 1::-1]
    left[line] = 1000 + np.arange(4)[:, np.newaxis] * (160, 100)
    right[same, 2] = right[same, 3]
    # Legs of 2 px: twice the areas are 4 px².
    left[small] = right[small] = 1000 + np.array([(0, 0), (32, 0), (0, 32), (32, 32)])
    _, valid = solved(left, right)
    assert valid.tolist() == [True, False, False, False, False, False]
    left[small] = right[small] = 1000 + 2 * np.array([(0, 0), (32, 0), (0, 32), (32, 32)])
    assert solved(left, right)[1][small]


def test_the_identity_is_exact() -> None:
    left, _ = samples(1)
    hypotheses, valid = solved(left, left)
    assert valid.all()
    np.testing.assert_allclose(hypotheses[0] / hypotheses[0].max(), np.eye(3), atol=2**-22)
