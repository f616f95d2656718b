"""Sums of three products, a bit of one factor in a clock, for poses: they are few, and may take their time."""

from amaranth import Module, Mux, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden_model.geometry.fixed_point import ENTRY
from golden_model.painting.pose import POSE, SUM_SHIFT
from hdl.lib.add_subtract import add_or_subtract

TERMS = 3
SUM = signed(POSE.bits + SUM_SHIFT)
"""Of `TERMS` products of a `POSE` and an `ENTRY`."""


class SerialSum(wiring.Component):
    """A sum of three products, from a memory's words.

    First come the three first factors, of which the leading 25 bits count; then the three second factors in the same
    order, once for each of these bits, the leading one first.
    """

    i_valid: In(1)
    i_word: In(signed(POSE.bits))
    i_term: In(range(TERMS))
    i_second: In(1)
    """The word is a second factor."""
    i_first_bit: In(1)
    """It is multiplied by the sign."""
    i_subtract: In(1)
    """The product is subtracted."""
    i_skip: In(1)
    """The first factor counts as 0."""
    i_double: In(1)
    """Without a word: doubles the sum."""
    o: Out(SUM)
    """`latency_cycles` after the last word."""

    latency_cycles = 2

    def elaborate(self, platform: object) -> Module:
        """The first factors shift in turn, and their bits gate what is added to twice the sum."""
        m = Module()
        bits = [Signal(ENTRY.bits, name=f"bits{n}", reset_less=True) for n in range(TERMS)]
        loaded = self.i_word[POSE.bits - ENTRY.bits :]
        with m.If(self.i_valid):
            m.d.sync += [bits[0].eq(bits[1]), bits[1].eq(bits[2])]
            m.d.sync += bits[2].eq(Mux(self.i_second, bits[0] << 1, Mux(self.i_skip, 0, loaded)))
        adds = self.i_valid & self.i_second
        operand = Signal(signed(POSE.bits), reset_less=True)
        subtracts, doubles, clears = Signal(), Signal(), Signal()
        m.d.sync += [
            operand.eq(Mux(adds & bits[0][-1], self.i_word, 0)),
            subtracts.eq(self.i_first_bit ^ self.i_subtract),
            doubles.eq((adds & (self.i_term == 0)) | self.i_double),
            clears.eq(self.i_valid & ~self.i_second),
        ]
        total = Signal(SUM, reset_less=True)
        with m.If(clears):
            m.d.sync += total.eq(0)
        with m.Else():
            m.d.sync += total.eq(add_or_subtract(Mux(doubles, total << 1, total), operand, subtracts))
        m.d.comb += self.o.eq(total)
        return m
