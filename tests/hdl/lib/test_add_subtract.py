# amaranth: UnusedElaboratable=no
"""The sum and the difference of any two numbers, whatever their widths."""

import itertools

import pytest
from amaranth import Module, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.add_subtract import add_or_subtract
from tests.hdl.drivers import run_clocks


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
