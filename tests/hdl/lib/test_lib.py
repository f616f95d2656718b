# amaranth: UnusedElaboratable=no
"""Sums, differences, products and counts against the numbers that they are."""

import itertools
from typing import Any

import numpy as np
import pytest
from amaranth import Module, Signal, signed, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from hdl.lib.add_subtract import add_or_subtract
from hdl.lib.multiplier import multiply_wide
from hdl.lib.popcount import Popcount
from tests.hdl.drivers import run_clocks

WIDE, NARROW = signed(25), unsigned(16)
LARGEST = 1 << WIDE.width - 1
FACTORS = [(a, b) for a in (-LARGEST, -1, 0, (1 << 17) - 1, 1 << 17, LARGEST - 1) for b in (0, 1, (1 << 16) - 1)]
FACTORS += np.random.default_rng(1).integers((-LARGEST, 0), (LARGEST, 1 << NARROW.width), (300, 2)).tolist()


def test_a_wide_product_takes_two_clocks() -> None:
    """As on the ECP5, in `test_ecp5`."""
    m = Module()
    wide, narrow = Signal(WIDE), Signal(NARROW)
    product = multiply_wide(m, None, wide, narrow)

    async def run(context: Any) -> None:
        for number in range(len(FACTORS) + 2):
            a, b = FACTORS[min(number, len(FACTORS) - 1)]
            context.set(wide, a)
            context.set(narrow, b)
            if number >= 2:
                before, other = FACTORS[number - 2]
                assert context.get(product) == before * other
            await context.tick()

    simulator = Simulator(m)
    simulator.add_clock(1e-6)
    simulator.add_testbench(run)
    simulator.run()


class Sum(wiring.Component):
    """The result in more bits than it needs."""

    def __init__(self, a_bits: int, b_bits: int) -> None:
        super().__init__(
            {"i_a": In(signed(a_bits)), "i_b": In(signed(b_bits)), "i_subtract": In(1), "o": Out(signed(8))}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        # A register, so that the block has a clock.
        m.d.sync += Signal().eq(1)
        m.d.comb += self.o.eq(add_or_subtract(self.i_a, self.i_b, self.i_subtract))
        return m


@pytest.mark.parametrize("widths", [(3, 3), (4, 2), (2, 4)])
def test_the_result_is_the_sum_or_the_difference(widths: tuple[int, int]) -> None:
    dut = Sum(*widths)
    cases = list(itertools.product(*(range(-(1 << bits - 1), 1 << bits - 1) for bits in widths), (0, 1)))
    rows = [list(zip((dut.i_a, dut.i_b, dut.i_subtract), case, strict=True)) for case in cases]
    results = [value for (value,) in run_clocks(dut, rows, [dut.o])]
    assert results == [a - b if subtract else a + b for a, b, subtract in cases]


@pytest.mark.parametrize(("bits", "lanes"), [(3, 2), (8, 3), (24, 2), (256, 1)])
def test_popcount_counts_the_ones_of_each_lane(bits: int, lanes: int) -> None:
    dut = Popcount(bits=bits, lanes=lanes)
    rng = np.random.default_rng(bits)
    inputs = rng.random((25, bits, lanes)) < rng.random((25, 1, lanes))
    inputs[0], inputs[1] = 0, 1
    valid = rng.random(25) < 0.7
    valid[:2] = True
    values = (inputs << np.arange(lanes)).sum(axis=2).tolist()
    rows = [
        [(dut.i_valid, bool(is_valid)), *zip(dut.i_planes, planes, strict=True)]
        for is_valid, planes in zip(valid, values, strict=True)
    ]
    rows += [[]] * dut.latency_cycles  # the last planes stay at the inputs
    counts = run_clocks(dut, rows, dut.o_counts)[dut.latency_cycles :]
    # A count stays until the next valid input.
    last_valid = np.maximum.accumulate(np.where(valid, np.arange(25), 0))
    np.testing.assert_array_equal(counts, inputs.sum(axis=1)[last_valid])


def test_popcount_refuses_too_few_bits() -> None:
    with pytest.raises(ValueError, match="bits is 2"):
        Popcount(bits=2, lanes=1)
