"""The thesis's fuzzy correlation in hardware (Tables III-1, III-2): the weight of a match from its two 3x3 windows."""

import math
from fractions import Fraction

from amaranth import Module, Mux, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.matching import rule_bases
from golden_model.matching.correlation import NCC, SAD_PER_PIXEL, ZSSD_PER_PIXEL
from hdl.fuzzy.sugeno import Sugeno
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.matching.correlation import PIXELS, WINDOWS, WindowCorrelation

SCALE_CYCLES = 3
"""Operand, multiplier and product register."""
_ENTRIES = 256
"""Scaled scores saturate here; the tables of SAD and of ZSSD are shorter."""


class FuzzyCorrelation(Component):
    """The 27 rules over SAD, ZSSD and NCC of two windows, equal to `golden_model.matching.rule_bases.correlation`.

    SAD and ZSSD are taken per pixel, as `golden_model.matching.correlation.fuzzy_inputs` does.
    """

    i: In(stream.Signature(WINDOWS))
    """Stream of `hdl.matching.correlation.WINDOWS`. Accepted one clock after the result."""
    o: stream.Interface
    """Stream of `hdl.fuzzy.sugeno.RESULT`."""

    latency_cycles: int
    """From ``i.valid`` to ``o.valid``."""

    def __init__(self) -> None:
        self._correlation = WindowCorrelation()
        self._rules = Sugeno(system=rule_bases.correlation(), value_bits=NCC.bits)
        self.latency_cycles = self._correlation.latency_cycles + SCALE_CYCLES + self._rules.latency_cycles
        super().__init__(o=Out(self._rules.o.signature))

    def elaborate(self, platform: object) -> Module:
        """Window scores, scaled to table indices, then the rules."""
        m = Module()
        m.submodules.correlation = correlation = self._correlation
        m.submodules.rules = rules = self._rules
        wiring.connect(m, wiring.flipped(self.i), correlation.i)
        wiring.connect(m, rules.o, wiring.flipped(self.o))
        scores = correlation.o.payload
        values = (
            _scale(m, scores.sad, Fraction(SAD_PER_PIXEL.one, PIXELS)),
            _scale(m, scores.zssd, Fraction(ZSSD_PER_PIXEL.one, PIXELS**2)),
            scores.ncc,
        )
        m.d.comb += [sink.eq(value) for sink, value in zip(rules.i.payload, values, strict=True)]
        # The scores wait at the correlation's output until the scaled ones have passed their registers.
        settled = delayed(m, correlation.o.valid, SCALE_CYCLES, reset_less=False)
        m.d.comb += [rules.i.valid.eq(correlation.o.valid & settled), correlation.o.ready.eq(rules.i.ready)]
        return m


def scale_constants(factor: Fraction) -> tuple[int, int, int]:
    """``limit, multiplier, shift``: below the limit ``score * multiplier >> shift`` is ``score * factor`` rounded down.

    The multiplier is the factor rounded up, with enough fraction bits that the error stays below the distance to the
    next whole number. The limit is where the result would be `_ENTRIES`.
    """
    limit = math.ceil(_ENTRIES / factor)
    shift = (limit * factor.denominator).bit_length()
    return limit, math.ceil(factor * (1 << shift)), shift


def _scale(m: Module, score: Value, factor: Fraction) -> Value:
    """``score * factor`` rounded down; larger scores saturate below `_ENTRIES`, still beyond the tables."""
    limit, multiplier, shift = scale_constants(factor)
    # Clipped first, which keeps the multiplier narrow.
    clipped = delayed(m, Mux(score < limit, score, limit - 1), 1)
    return delayed(m, clipped * multiplier, 2)[shift:]
