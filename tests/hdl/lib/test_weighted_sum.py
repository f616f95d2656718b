# amaranth: UnusedElaboratable=no
import itertools
from typing import Any

import numpy as np
import pytest
from amaranth.hdl import signed, unsigned
from hypothesis import given
from hypothesis import strategies as st

from hdl.blocks.vectors import of_stream
from hdl.lib.weighted_sum import WeightedSum, signed_digits
from sim.benches.rows import check
from tests.hdl.rows import Clocked


@given(st.integers(-(1 << 40), 1 << 40))
def test_signed_digits_give_the_constant_without_neighbours(constant: Any) -> None:
    digits = signed_digits(constant)
    shifts = [shift for shift, _ in digits]
    assert sum(sign << shift for shift, sign in digits) == constant
    assert all(after - before >= 2 for before, after in itertools.pairwise(shifts))


@pytest.mark.parametrize(
    ("weights", "shape", "latency_cycles"),
    [
        ((64, 59, 45, 24), unsigned(14), 4),
        ((815, -4096), unsigned(23), 3),
        ((-3, 0, 7), signed(9), 2),
        ((-5,), unsigned(4), 1),
        ((8,), signed(4), 1),
    ],
)
def test_sum_is_exact_at_its_latency(weights: tuple[Any, ...], shape: Any, latency_cycles: int) -> None:
    dut = WeightedSum(weights=weights, shape=shape)
    assert dut.latency_cycles == latency_cycles
    low, high = (-(1 << shape.width - 1), (1 << shape.width - 1) - 1) if shape.signed else (0, (1 << shape.width) - 1)
    rng = np.random.default_rng(3)
    vectors = rng.integers(low, high + 1, (60, len(weights)))
    vectors[0] = np.where(np.array(weights) > 0, high, low)
    vectors[1] = np.where(np.array(weights) > 0, low, high)
    sums = (vectors @ np.array(weights)).tolist()
    assert (dut.low, dut.high) == (sums[1], sums[0])
    check(
        of_stream(Clocked(dut), "", [{"values": each} for each in vectors.tolist()], [{"sum": each} for each in sums])
    )


def test_weights_that_are_all_zero_are_refused() -> None:
    with pytest.raises(ValueError, match=r"weights are \[0, 0\]"):
        WeightedSum(weights=(0, 0), shape=unsigned(8))
