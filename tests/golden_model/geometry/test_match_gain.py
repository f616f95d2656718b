"""Integer gains against the same formula in floating point, and the bounds of every width."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Array
from golden_model.formats import POSITION
from golden_model.geometry import match_gain
from golden_model.geometry.estimator import MAX_MATCHES
from golden_model.geometry.fixed_point import ENTRY, quantise
from golden_model.geometry.match_gain import LEVELS, TOLERANCE_PX, gain

IDENTITY = np.eye(3)
SHIFTED = np.array([[1.0, 0, 40], [0, 1, 25], [0, 0, 1]])
TURNED = np.array([[-0.99, 0.1, 1250], [-0.1, -0.99, 980], [4e-5, -3e-5, 1]])
ENLARGED = np.array([[4.0, 0.2, -2400], [-0.1, 4, -1700], [1e-4, 5e-5, 1]])
REDUCED = np.array([[0.25, 0.02, 200], [0.01, 0.25, 300], [2e-4, -1e-4, 1]])


def mapped(H: Array, points: Array) -> Array:
    lifted = np.hstack((points, np.ones((len(points), 1)))) @ H.T
    return lifted[:, :2] / lifted[:, 2:]


def matches(
    H: Array, count: int = 1500, spread_px: float = 2.5, seed: int = 1
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Positions in 1/16 px whose errors cover the tolerance."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, [1280 * 16, 960 * 16], (count, 2))
    right = np.rint(16 * (mapped(H, left / 16) + rng.normal(0, spread_px, (count, 2)))).astype(np.int64)
    inside = ((right >= 0) & (right <= POSITION.max_raw)).all(axis=1)
    return left[inside], right[inside]


@pytest.mark.parametrize("H", [IDENTITY, SHIFTED, TURNED, ENLARGED, REDUCED], ids=["I", "shift", "turn", "4x", "1/4"])
def test_the_gain_is_the_truncated_quadratic_rounded_up(H: Array) -> None:
    left, right = matches(H)
    assert len(left) > 400
    squared_error = ((mapped(H, left / 16) - right / 16) ** 2).sum(axis=1)
    exact = LEVELS * np.maximum(0, 1 - squared_error / (2 * TOLERANCE_PX**2))
    near = exact > 0
    assert 0.3 < near.mean() < 0.99
    gains = gain(quantise(H[np.newaxis]), left, right)[0]
    # Rounded up to a whole step; 0.02 of a step is left for the rounding of the nine elements.
    assert ((gains - exact)[near] > -0.02).all()
    assert ((gains - exact)[near] < 1.02).all()
    assert (gains[exact == 0] <= 1).all()


def test_matches_behind_the_camera_do_not_count_and_degenerate_ones_do() -> None:
    front, behind = gain(quantise(np.stack((SHIFTED, -SHIFTED))), *matches(SHIFTED, spread_px=0.5))
    assert front.mean() > 10
    assert not behind.any()
    # A point that everything maps to, and a line at infinity: no match is near, or only those at the point.
    point = np.array([[0.0, 0, 100], [0, 0, 50], [0, 0, 1]])
    horizon = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 0]])
    left, right = np.array([[16, 16], [800, 640]]), np.array([[1600, 800], [16, 16]])
    assert gain(quantise(np.stack((point, horizon))), left, right).tolist() == [[LEVELS, 0], [0, 0]]


def test_every_width_holds_the_extremes() -> None:
    """Interval arithmetic by corners: each quantity is linear in each of its factors."""
    h, position = ENTRY.min_raw, POSITION.max_raw
    sums = [
        a * x + b * y + (c << 16)
        for a, b, c in itertools.product((h, -h - 1), repeat=3)
        for x, y in itertools.product((0, position), repeat=2)
    ]
    assert max(map(abs, sums)) == match_gain.MAX_SUM < 2**42
    terms = [value + (1 << 17) >> 18 for value in sums]
    assert max(map(abs, terms)) <= match_gain.MAX_TERM < 2**24
    misses = [
        (a << 16) - x * w for a, w in itertools.product((min(terms), max(terms)), repeat=2) for x in (0, position)
    ]
    assert max(map(abs, misses)) <= match_gain.MAX_MISS < 2**41
    # The limit of the error lies beyond the tolerance of the largest depth, so limited errors never count.
    assert match_gain.ERROR_FACTOR * match_gain.ERROR.max_raw**2 > match_gain.MAX_SQUARED_DEPTH
    assert LEVELS * match_gain.MAX_SQUARED_ERROR < 2**63
    assert MAX_MATCHES * 255 * LEVELS < 2**24
