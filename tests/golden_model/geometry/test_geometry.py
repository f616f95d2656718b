"""Numbers, samples and solutions of the estimator, against double precision and the host's solver."""

import numpy as np
import pytest

from golden_model.arrays import Array
from golden_model.geometry import estimator
from golden_model.geometry.acceptance import INLIER_GAIN, count_cells
from golden_model.geometry.fixed_point import quantise
from golden_model.geometry.floating import MANTISSA_BITS, MAX_EXPONENT, MIN_EXPONENT, SEEDS, Floats
from golden_model.geometry.match_gain import LEVELS, TOLERANCE_PX
from golden_model.geometry.ordering import BINS, order
from golden_model.geometry.refit import SUMS, factors, solve_sums
from golden_model.geometry.sampling import STEPS, draw, subset_size
from golden_model.geometry.solving import areas, solve
from skymosaic.geometry.homography import apply, dlt, transfer_error
from tests.golden_model.geometry.execution import to_real

PRECISION = 2.0 ** (1 - MANTISSA_BITS)


def reals(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, count) * 2.0 ** rng.integers(-30, 31, count)


def test_sums_of_products_are_those_of_double_precision() -> None:
    a, b, c = (reals(5000, seed) for seed in (1, 2, 3))
    x, y, z = map(Floats.from_real, (a, b, c))
    a, b, c = (to_real(number) for number in (x, y, z))
    # One place of the larger term for each term that is cut off, and one of the result.
    bound = 3 * PRECISION * (np.abs(a * b) + np.abs(c))
    assert (np.abs(to_real(z.plus(x, y)) - (c + a * b)) <= bound).all()
    assert (np.abs(to_real(z.minus(x, y)) - (c - a * b)) <= bound).all()


def test_what_was_loaded_is_normalised_without_loss() -> None:
    values = np.array([0, 1, 2, 3, 1 << 15, (1 << 16) - 1])
    zero, one = Floats.from_real(np.zeros(6)), Floats.from_real(np.ones(6))
    number = zero.plus(one, Floats.from_integers(values, 16))
    np.testing.assert_array_equal(to_real(number) * (1 << 16), values)
    assert (number.mantissa[1:] >> MANTISSA_BITS - 1 == 1).all()
    assert (number.mantissa[0], number.exponent[0]) == (0, MIN_EXPONENT)


def test_zeros_and_exponents_at_their_limits() -> None:
    small, zero = Floats.from_real(np.array([2.0**-200])), Floats.from_real(np.zeros(1))
    huge = Floats.from_real(np.array([2.0**300]))
    assert to_real(small.plus(zero, huge)) == 2.0**-200
    difference = huge.minus(huge, Floats.from_real(np.ones(1)))
    assert (difference.mantissa[0], difference.exponent[0]) == (0, MIN_EXPONENT)
    numbers = {e: Floats(np.array([1 << MANTISSA_BITS - 1]), np.array([e]), np.array([False])) for e in (-500, 500)}
    zero = Floats.from_real(np.zeros(1))
    assert to_real(zero.plus(numbers[-500], numbers[-500])) == 0
    assert zero.plus(numbers[500], numbers[500]).exponent == MAX_EXPONENT
    assert zero.seed().exponent == MAX_EXPONENT


def test_seeds_approximate_reciprocals_to_seven_bits() -> None:
    values = np.linspace(1, 2, 4000, endpoint=False) * np.repeat([2.0**-9, -(2.0**7)], 2000)
    assert (np.abs(to_real(Floats.from_real(values).seed()) * values - 1) < 2**-7).all()
    assert (min(SEEDS), max(SEEDS)) == (128, 255)


IDENTITY = np.eye(3)
SHIFTED = np.array([[1.0, 0, 40], [0, 1, 25], [0, 0, 1]])


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
def test_what_cannot_be_quantised_is_refused(homographies: Array, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        quantise(homographies)


def test_weights_are_ordered_and_equal_ones_keep_their_order() -> None:
    assert order(np.array([3, 255, 0, 3, 255])).tolist() == [1, 4, 0, 3, 2]
    weight = np.random.default_rng(1).integers(0, BINS, 2000)
    assert order(weight.astype(np.uint8)).tolist() == sorted(range(2000), key=lambda n: -weight[n])
    assert np.iinfo(np.uint8).max + 1 == BINS


@pytest.mark.parametrize("size", [4, 5, 40, 2048])
def test_ranks_are_different_and_equally_frequent(size: int) -> None:
    state, samples = 1, []
    for _ in range(4000):
        sample, state = draw(state, size)
        samples.append(sample)
    assert all(len(set(sample)) == 4 for sample in samples)
    counts = np.bincount(np.ravel(samples), minlength=size)
    assert len(counts) == size
    expected = 4 * 4000 / size
    # The variance of a count is below its mean; chi-squared over the ranks.
    assert ((counts - expected) ** 2 / expected).sum() < size + 5 * np.sqrt(2 * size)


def test_subsets_grow_to_all_matches() -> None:
    sizes = [subset_size(700, step) for step in range(STEPS)]
    assert sizes == sorted(sizes)
    assert sizes[-1] == 700
    assert sizes == [-(-700 * (step + 1) // STEPS) for step in range(STEPS)]
    assert [subset_size(4, step) for step in range(STEPS)] == [4] * STEPS


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
    return estimator.quantise(rows), np.all([estimator.passes(each) for each in products], axis=0)


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


def test_what_is_an_inlier_and_which_cells_it_is_in() -> None:
    left, _ = samples(1)
    hypotheses, valid = solved(left, left)
    assert valid.all()
    np.testing.assert_allclose(hypotheses[0] / hypotheses[0].max(), np.eye(3), atol=2**-22)
    size = (650, 487)
    edges = np.array([2 * 650, 2 * 487])
    inside = np.array([[0, 0], edges - 1])
    assert count_cells(inside, size) == 1
    assert count_cells(np.vstack((inside, [edges])), size) == 2
    assert count_cells(np.array([[16 * 650 - 1, 16 * 487 - 1], [65535, 65535]]), size) == 1
    centres = np.array([(2 * column + 1, 2 * row + 1) for column in range(8) for row in range(8)]) * edges // 2
    assert count_cells(np.repeat(centres, 2, axis=0), size) == 64
    assert count_cells(centres[:0], size) == 0
    # The gain is 32 (1 - e² / 2 tau²), rounded up.
    steps = LEVELS - INLIER_GAIN + 1
    assert 1.95 < np.sqrt(2 * steps / LEVELS) * TOLERANCE_PX < 2


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


def test_matches_on_a_line_give_numbers_like_any_other() -> None:
    left = 1000 + np.arange(20)[:, np.newaxis] * (16, 8)
    H, _ = fitted(left, left, np.full(20, 9))
    assert np.isfinite(H).all()
    none = np.zeros((0, 2), dtype=np.int64)
    assert np.isfinite(fitted(none, none, none[:, 0])[0]).all()
