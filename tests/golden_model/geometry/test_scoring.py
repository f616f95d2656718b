"""Integer scores against the same formula in floating point, the bounds of every width, and what is refused."""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.formats import POSITION
from golden_model.geometry import scoring
from golden_model.geometry.scoring import LEVELS, MAX_MATCHES, TOLERANCE_PX, ScoreCause, finish_cycles, quantise, score

IDENTITY = np.eye(3)
SHIFTED = np.array([[1.0, 0, 40], [0, 1, 25], [0, 0, 1]])
TURNED = np.array([[-0.99, 0.1, 1250], [-0.1, -0.99, 980], [4e-5, -3e-5, 1]])
ENLARGED = np.array([[4.0, 0.2, -2400], [-0.1, 4, -1700], [1e-4, 5e-5, 1]])
REDUCED = np.array([[0.25, 0.02, 200], [0.01, 0.25, 300], [2e-4, -1e-4, 1]])


def mapped(H: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    lifted = np.hstack((points, np.ones((len(points), 1)))) @ H.T
    return lifted[:, :2] / lifted[:, 2:]


def matches(
    H: NDArray[np.float64], count: int = 1500, spread_px: float = 2.5, seed: int = 1
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Positions in 1/16 px whose errors cover the tolerance, and weights."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, [1280 * 16, 960 * 16], (count, 2))
    right = np.rint(16 * (mapped(H, left / 16) + rng.normal(0, spread_px, (count, 2)))).astype(np.int64)
    inside = ((right >= 0) & (right <= POSITION.max_raw)).all(axis=1)
    return left[inside], right[inside], rng.integers(0, 256, inside.sum())


@pytest.mark.parametrize("H", [IDENTITY, SHIFTED, TURNED, ENLARGED, REDUCED], ids=["I", "shift", "turn", "4x", "1/4"])
def test_the_gain_is_the_truncated_quadratic_rounded_up(H: NDArray[np.float64]) -> None:
    left, right, weight = matches(H)
    assert len(left) > 400
    squared_error = ((mapped(H, left / 16) - right / 16) ** 2).sum(axis=1)
    exact = LEVELS * np.maximum(0, 1 - squared_error / (2 * TOLERANCE_PX**2))
    near = exact > 0
    assert 0.3 < near.mean() < 0.99
    gain = np.array([score(quantise(H[np.newaxis]), *each).score[0] for each in single(left, right)])
    # Rounded up to a whole step; 0.02 of a step is left for the rounding of the nine elements.
    assert ((gain - exact)[near] > -0.02).all()
    assert ((gain - exact)[near] < 1.02).all()
    assert (gain[exact == 0] <= 1).all()
    result = score(quantise(H[np.newaxis]), left, right, weight)
    assert result.score == gain @ weight
    assert result.support == weight[gain > 0].sum()
    assert result.causes == 0


def single(left: NDArray[np.int64], right: NDArray[np.int64]) -> Iterator[Any]:
    """Every match as a set of its own with weight 1."""
    return ((a[np.newaxis], b[np.newaxis], np.ones(1, int)) for a, b in zip(left, right, strict=True))


def test_matches_behind_the_camera_do_not_count() -> None:
    left, right, weight = matches(SHIFTED, spread_px=0.5)
    front, behind = score(quantise(np.stack((SHIFTED, -SHIFTED))), left, right, weight).score
    assert front > 10 * weight.sum()
    assert behind == 0


def test_degenerate_hypotheses_have_a_score_like_any_other() -> None:
    """A point that everything maps to, and a line at infinity: no match is near, or only those at the point."""
    point = np.array([[0.0, 0, 100], [0, 0, 50], [0, 0, 1]])
    horizon = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 0]])
    left, right = np.array([[16, 16], [800, 640]]), np.array([[1600, 800], [16, 16]])
    result = score(quantise(np.stack((point, horizon))), left, right, np.array([7, 9]))
    assert result.score.tolist() == [7 * LEVELS, 0]
    assert result.causes.tolist() == [0, 0]


def test_every_width_holds_the_extremes() -> None:
    """Interval arithmetic by corners: each quantity is linear in each of its factors."""
    h, position = scoring.ENTRY.min_raw, POSITION.max_raw
    sums = [
        a * x + b * y + (c << 16)
        for a, b, c in itertools.product((h, -h - 1), repeat=3)
        for x, y in itertools.product((0, position), repeat=2)
    ]
    assert max(map(abs, sums)) == scoring.MAX_SUM < 2**42
    terms = [value + (1 << 17) >> 18 for value in sums]
    assert max(map(abs, terms)) <= scoring.MAX_TERM < 2**24
    misses = [
        (a << 16) - x * w for a, w in itertools.product((min(terms), max(terms)), repeat=2) for x in (0, position)
    ]
    assert max(map(abs, misses)) <= scoring.MAX_MISS < 2**41
    # The limit of the error lies beyond the tolerance of the largest depth, so limited errors never count.
    assert scoring.ERROR_FACTOR * scoring.ERROR.max_raw**2 > scoring.MAX_SQUARED_DEPTH
    assert LEVELS * scoring.MAX_SQUARED_ERROR < 2**63
    assert MAX_MATCHES * 255 * LEVELS < 2**24


def test_a_homography_is_scaled_to_its_largest_element() -> None:
    result = quantise(np.stack((SHIFTED, 1e-300 * SHIFTED, -SHIFTED)))
    np.testing.assert_array_equal(result[0], result[1])
    assert np.abs(result).max(axis=(1, 2)).tolist() == [2**24 - 1] * 3
    # Half of an element rounds up, also where it is negative.
    assert result[0, 0, 2] == np.floor(40 / 4096 * (2**24 - 1) + 0.5)
    assert result[2, 0, 2] == np.floor(-40 / 4096 * (2**24 - 1) + 0.5)


@pytest.mark.parametrize(
    ("homographies", "message"),
    [
        (np.eye(3), "shape"),
        (np.ones((1, 3, 4)), "shape"),
        (np.stack((IDENTITY, np.zeros((3, 3)))), "homography 1 is zero or not finite"),
        (np.full((1, 3, 3), np.nan), "homography 0"),
        (np.stack((IDENTITY, IDENTITY, np.full((3, 3), np.inf))), "homography 2"),
    ],
)
def test_what_cannot_be_quantised_is_refused(homographies: NDArray[np.float64], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        quantise(homographies)


def test_hypotheses_out_of_range_have_a_cause_and_no_score() -> None:
    left, right, weight = matches(SHIFTED, count=30, spread_px=0.1)
    good = quantise(SHIFTED[np.newaxis])[0]
    low, high = good.copy(), good.copy()
    low[2, 0], high[0, 0] = scoring.ENTRY.min_raw - 1, scoring.ENTRY.max_raw + 1
    result = score(np.stack((good, low, high, good >> 2, 0 * good)), left, right, weight)
    assert result.causes.tolist() == [0, *[ScoreCause.OUT_OF_RANGE] * 2, *[ScoreCause.NOT_NORMALISED] * 2]
    assert result.score[0] > 0
    assert not result.score[1:].any()
    assert not result.support[1:].any()


def test_sets_of_no_and_of_too_many_matches_have_a_cause() -> None:
    left, right, weight = matches(SHIFTED, count=30)
    hypothesis = quantise(SHIFTED[np.newaxis])
    assert score(hypothesis, left[:0], right[:0], weight[:0]).causes == ScoreCause.NO_MATCHES
    result = score(hypothesis, left, right, weight, max_matches=len(left) - 1)
    assert (result.causes.tolist(), result.score.tolist()) == ([ScoreCause.TOO_MANY_MATCHES], [0])


@pytest.mark.parametrize(
    "wrong",
    [
        {"left": [[-1, 0]]}, {"right": [[0, 1 << 16]]}, {"weight": [256]}, {"weight": [1, 2]},
        {"right": [[3, 4, 5]]}, {"left": [1, 2], "right": [3, 4]}, {"left": [[1, 2, 3]], "right": [[3, 4, 5]]},
    ],
)  # fmt: skip
def test_matches_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    given = {"left": [[1, 2]], "right": [[3, 4]], "weight": [5], **wrong}
    left, right, weight = map(np.array, given.values())
    with pytest.raises(ValueError, match=r"must be|shape"):
        score(quantise(IDENTITY[np.newaxis]), left, right, weight)


def test_eighty_thousand_hypotheses_a_second() -> None:
    """At 1850 matches and 150 MHz, with everything that a hypothesis takes: 500 of them within 6.2 ms."""
    cycles = finish_cycles(1850, 500)
    assert 150e6 * 500 / cycles[-1] > 80_000
    assert cycles[-1] / 150e6 < 6.2e-3
