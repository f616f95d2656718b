"""The estimator's arithmetic against double precision."""

import numpy as np

from golden_model.geometry.floating import MANTISSA_BITS, MAX_EXPONENT, MIN_EXPONENT, SEEDS, Floats
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


def test_a_zero_never_hides_the_other_term() -> None:
    small, zero = Floats.from_real(np.array([2.0**-200])), Floats.from_real(np.zeros(1))
    huge = Floats.from_real(np.array([2.0**300]))
    assert to_real(small.plus(zero, huge)) == 2.0**-200
    difference = huge.minus(huge, Floats.from_real(np.ones(1)))
    assert (difference.mantissa[0], difference.exponent[0]) == (0, MIN_EXPONENT)


def test_exponents_are_limited() -> None:
    numbers = {e: Floats(np.array([1 << MANTISSA_BITS - 1]), np.array([e]), np.array([False])) for e in (-500, 500)}
    zero = Floats.from_real(np.zeros(1))
    assert to_real(zero.plus(numbers[-500], numbers[-500])) == 0
    assert zero.plus(numbers[500], numbers[500]).exponent == MAX_EXPONENT
    assert zero.seed().exponent == MAX_EXPONENT


def test_seeds_approximate_reciprocals_to_seven_bits() -> None:
    values = np.linspace(1, 2, 4000, endpoint=False) * np.repeat([2.0**-9, -(2.0**7)], 2000)
    assert (np.abs(to_real(Floats.from_real(values).seed()) * values - 1) < 2**-7).all()
    assert (min(SEEDS), max(SEEDS)) == (128, 255)
