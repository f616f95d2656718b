"""The refit against the host's weighted DLT and the truth, on few and many, spread and crowded matches."""

import numpy as np
import pytest

from golden_model.geometry.floating import Floats
from golden_model.geometry.match_gain import LEVELS, TOLERANCE_PX
from golden_model.geometry.program import Value, constants, held
from golden_model.geometry.refit import BANDS, SUMS, factors, solve_sums
from skymosaic.geometry.homography import apply, transfer_error
from tests.golden_model.geometry.execution import to_real

TRUTH = np.array([[1.02, 0.05, 30.0], [-0.04, 0.97, 10.0], [5e-5, 2e-5, 1.0]])
SIZE = (640, 480)


def fitted(left: np.ndarray, right: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, float]:
    """The homography in pixels, and its determinant in the units of the hardware."""
    zero, one = (Floats.from_real(np.full(1, float(value))) for value in (0, 1))
    centre = [zero.plus(one, Floats.from_integers(np.array([side * 8]), 16)) for side in SIZE]
    match = [Floats.from_integers(side[:, axis], 16) for side in (left, right) for axis in range(2)]
    pairs = factors(zero, one, centre, match, Floats.from_integers(weight, 8))
    first, second = (Floats.stack([pair[n] for pair in pairs]) for n in range(2))
    sums = Floats.from_real(np.zeros(SUMS))
    for n in range(len(weight)):
        sums = sums.plus(first[n], second[n])
    rows, determinant = solve_sums(zero, one, centre, [sums[n : n + 1] for n in range(SUMS)])
    units = np.array([4096.0, 4096, 1])
    H = np.array([[to_real(each)[0] for each in row] for row in rows]) * units[:, np.newaxis] / units
    return H, float(to_real(determinant)[0])


def in_double(left: np.ndarray, right: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The same least squares by QR, in positions from the frame's centre."""
    centre = np.array(SIZE) / 2
    (x, y), (u, v) = ((side / 16 - centre).T / 512 for side in (left, right))
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = np.vstack(
        (
            np.stack((x, y, one, zero, zero, zero, -u * x, -u * y), axis=1),
            np.stack((zero, zero, zero, x, y, one, -v * x, -v * y), axis=1),
        )
    )
    root = np.sqrt(np.tile(weight, 2))
    h, *_ = np.linalg.lstsq(rows * root[:, np.newaxis], np.concatenate((u, v)) * root, rcond=None)
    normal = np.array([[1 / 512, 0, -centre[0] / 512], [0, 1 / 512, -centre[1] / 512], [0, 0, 1]])
    return np.linalg.inv(normal) @ np.append(h, 1).reshape(3, 3) @ normal


@pytest.mark.parametrize(("count", "side_px"), [(4, 400), (12, 300), (60, 120), (500, 400)])
def test_the_refit_is_that_in_double_precision(count: int, side_px: int) -> None:
    rng = np.random.default_rng(count)
    left = rng.integers(60 * 16, (60 + side_px) * 16, (count, 2))
    right = np.rint(16 * (apply(TRUTH, left / 16) + rng.normal(0, 0.3, left.shape))).astype(np.int64)
    weight = rng.integers(1, 256, count)
    H, determinant = fitted(left, right, weight)
    assert determinant == pytest.approx(np.linalg.det(H), rel=1e-6)
    # Between the two, at the matches: a hundredth of the positions' own step of 1/16 px.
    assert transfer_error(H, left / 16, apply(in_double(left, right, weight), left / 16)).max() < 16**-1 / 100


def test_the_bands_are_errors_that_narrow_to_two_pixels() -> None:
    # The gain is 32 (1 - e² / 2 tau²), rounded up.
    widths_px = [TOLERANCE_PX * np.sqrt(2 * (LEVELS - band + 1) / LEVELS) for band in BANDS]
    np.testing.assert_allclose(widths_px, [4.24, 3.67, 3, 2.12], atol=0.005)


def test_matches_on_a_line_give_numbers_like_any_other() -> None:
    left = 1000 + np.arange(20)[:, np.newaxis] * (16, 8)
    H, _ = fitted(left, left, np.full(20, 9))
    assert np.isfinite(H).all()
    none = np.zeros((0, 2), dtype=np.int64)
    assert np.isfinite(fitted(none, none, none[:, 0])[0]).all()


def test_the_equations_skip_what_is_zero() -> None:
    """The blocks of the left coordinates do not mix, so that fewer operations are needed than for any 8 equations."""
    zero, one = constants()
    rows, _ = solve_sums(zero, one, [held(30), held(31)], [held(2 + n) for n in range(SUMS)])
    seen: set[Value] = set()
    waiting = [value for row in rows for value in row]
    while waiting:
        value = waiting.pop()
        if value not in seen:
            seen.add(value)
            waiting += value.operands
    assert sum(bool(value.operands) for value in seen) < 200
