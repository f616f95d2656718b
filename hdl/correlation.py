"""Window correlation in hardware: the sum of absolute differences (thesis, equation III-1)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add

from amaranth import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden_model.formats import PIXEL
from hdl.delay import delayed

ADDENDS = 3
"""Terms an adder sums in one clock."""


class SumOfAbsoluteDifferences(wiring.Component):
    """``o_sum`` = sum of ``|i_left[n] - i_right[n]|``, every clock.

    Parameters
    ----------
    pixels : int
        Of a window.

    Members
    -------
    i_left, i_right : In(8).array(pixels)
    o_sum : Out(range(255 * pixels + 1))

    Attributes
    ----------
    latency_cycles : int
    """

    i_left: Sequence[Signal]
    i_right: Sequence[Signal]
    o_sum: Signal

    def __init__(self, *, pixels: int) -> None:
        self.pixels = pixels
        terms, self.latency_cycles = pixels, 1
        while terms > 1:
            terms = -(-terms // ADDENDS)
            self.latency_cycles += 1
        window = In(PIXEL.bits).array(pixels)
        super().__init__({"i_left": window, "i_right": window, "o_sum": Out(range(PIXEL.max_raw * pixels + 1))})

    def elaborate(self, platform: object) -> Module:
        """Differences, then a tree of adders."""
        m = Module()
        terms = []
        for left, right in zip(self.i_left, self.i_right, strict=True):
            difference = Signal(PIXEL.bits)
            m.d.comb += difference.eq(Mux(left > right, left - right, right - left))
            terms.append(delayed(m, difference, 1))
        while len(terms) > 1:
            terms = [delayed(m, reduce(add, terms[n : n + ADDENDS]), 1) for n in range(0, len(terms), ADDENDS)]
        m.d.comb += self.o_sum.eq(terms[0])
        return m
