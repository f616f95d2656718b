# amaranth: UnusedElaboratable=no
"""The estimator's arithmetic equals the golden model: random numbers of all sizes, cancellation, zeros and limits."""

from typing import Any

import numpy as np

from golden_model.geometry import floating as golden
from golden_model.geometry.floating import MANTISSA_BITS, MAX_EXPONENT, MIN_EXPONENT, Floats
from hdl.geometry.floating import MultiplyAdd
from tests.hdl.block_bench import BlockBench


def numbers(count: int, seed: int) -> Floats:
    """Normalised, not normalised, and zero, with exponents close to each other or far apart."""
    rng = np.random.default_rng(seed)
    mantissa = rng.integers(1 << MANTISSA_BITS - 1, 1 << MANTISSA_BITS, count)
    mantissa[::7] >>= rng.integers(1, 16, len(mantissa[::7]))
    exponent = rng.integers(-4, 5, count) * rng.choice([1, 1, 10, 120], count)
    mantissa[3::11], exponent[3::11] = 0, MIN_EXPONENT
    mantissa[5::13] = (1 << MANTISSA_BITS) - 1
    exponent[6::29], exponent[8::31] = MAX_EXPONENT, MIN_EXPONENT
    return Floats(mantissa, exponent, rng.random(count) < 0.5)


def payload(values: Floats, n: int) -> dict[str, Any]:
    return {name: int(getattr(values, name)[n]) for name in ("mantissa", "exponent", "negative")}


def test_every_result_equals_the_golden_model() -> None:
    count = 600
    a, b, c = (numbers(count, seed) for seed in (1, 2, 3))
    # Every third sum nearly cancels.
    product = golden.Floats.from_real(np.zeros(count)).plus(a, b)
    for name in ("mantissa", "exponent"):
        getattr(c, name)[::3] = getattr(product, name)[::3]
    c.mantissa[::6] ^= 1 << 5
    negate = np.random.default_rng(4).random(count) < 0.5
    plus, minus = c.plus(a, b), c.minus(a, b)
    expected = Floats(*(np.where(negate, getattr(minus, n), getattr(plus, n)) for n in vars(plus)))
    dut = MultiplyAdd()
    results: list[Any] = []

    async def run(ctx: Any) -> None:
        for n in range(count + dut.latency_cycles):
            for port, values in ((dut.i_a, a), (dut.i_b, b), (dut.i_c, c)):
                ctx.set(port, payload(values, min(n, count - 1)))
            ctx.set(dut.i_negate, int(negate[min(n, count - 1)]))
            await ctx.tick()
            results.append((ctx.get(dut.o.mantissa), ctx.get(dut.o.exponent), ctx.get(dut.o.negative)))

    BlockBench(dut, cycle_limit=1000).run(run)
    mantissa, exponent, negative = np.array(results[dut.latency_cycles - 1 : -1]).T
    np.testing.assert_array_equal(mantissa, expected.mantissa)
    np.testing.assert_array_equal(exponent, expected.exponent)
    # That of zeros, too: estimates differ where a pivot is a zero of the other sign.
    np.testing.assert_array_equal(negative == 1, expected.negative)
    assert (mantissa == 0).sum() > 30
    assert {MIN_EXPONENT, MAX_EXPONENT} < set(exponent)
