"""Sub-pixel positions of candidates: a parabola through three responses, separately in x and y."""

from amaranth import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden_model.formats import POSITION, RAW_RESPONSE, RESPONSE_CODE, RESPONSE_FRACTION_BITS
from hdl.lib.delay import delayed, port_register
from hdl.streams import CANDIDATE

OFFSET = signed(5)
"""Offset from the pixel's centre, -8 to 8 sixteenths."""
_VALUE_BITS = RAW_RESPONSE.bits - 2
"""Responses are positive and below 2**30."""
_MANTISSA_BITS = RESPONSE_FRACTION_BITS + 1
_MAX_EXPONENT = _VALUE_BITS - _MANTISSA_BITS
_QUOTIENT_BITS = 4


class Vertex(wiring.Component):
    """Vertex of the parabola through three response codes, one set of codes per clock.

    With u = centre - after and v = centre - before, ``o_offset`` is
    sign(v - u) * floor((16 |v - u| + u + v) / (2 (u + v))), and 0 where u + v = 0.
    """

    i_before: In(RESPONSE_CODE.bits)
    """Response code of the pixel before."""
    i_centre: In(RESPONSE_CODE.bits)
    """Response code of the candidate, at least as large as both others."""
    i_after: In(RESPONSE_CODE.bits)
    """Response code of the pixel after."""
    o_offset: Out(OFFSET)
    """In 1/16 px, -8 to 8, ``latency_cycles`` later."""

    latency_cycles = 5 + _QUOTIENT_BITS

    def elaborate(self, platform: object) -> Module:
        """Decode, subtract, then divide, one quotient bit per clock."""
        m = Module()
        before, centre, after = self._decode(m)
        fall_after = Signal(_VALUE_BITS, reset_less=True)
        fall_before = Signal(_VALUE_BITS, reset_less=True)
        m.d.sync += [fall_after.eq(centre - after), fall_before.eq(centre - before)]

        total = Signal(_VALUE_BITS + 1, reset_less=True)
        difference = Signal(_VALUE_BITS, reset_less=True)
        negative = Signal(reset_less=True)
        m.d.sync += [
            total.eq(fall_before + fall_after),
            negative.eq(fall_before < fall_after),
            difference.eq(Mux(fall_before < fall_after, fall_after - fall_before, fall_before - fall_after)),
        ]
        quotient = self._quotient(m, (difference << POSITION.fraction_bits) + total, total)
        # A quotient above 8 only comes from 0 / 0, where every trial subtraction succeeds.
        magnitude = Mux(quotient > POSITION.one // 2, 0, quotient)
        m.d.sync += self.o_offset.eq(Mux(delayed(m, negative, _QUOTIENT_BITS), -magnitude, magnitude))
        return m

    def _decode(self, m: Module) -> list[Value]:
        """Decode the three responses in two clocks, scaled so that the centre has the largest exponent.

        The vertex depends only on ratios of responses, so a common scale does not matter, and the centre needs no
        shifter.
        """
        codes = [self.i_before, self.i_centre, self.i_after]
        fields = [code[RESPONSE_FRACTION_BITS:] for code in codes]
        exponents = [field - field.any() for field in fields]
        values = []
        for code, field, exponent in zip(codes, fields, exponents, strict=True):
            mantissa = delayed(m, Cat(code[:RESPONSE_FRACTION_BITS], field.any()), 1)
            below_centre = delayed(m, (exponents[1] - exponent)[:5], 1)
            values.append(delayed(m, ((mantissa << _MAX_EXPONENT) >> below_centre)[:_VALUE_BITS], 1))
        return values

    @staticmethod
    def _quotient(m: Module, remainder: Value, total: Value) -> Value:
        """Divide ``remainder`` by ``2 * total``, rounded down, below 16: one trial subtraction per clock."""
        quotient: Value = Cat()
        for bit in reversed(range(_QUOTIENT_BITS)):
            trial = remainder - (total << bit + 1)
            fits = trial >= 0
            remainder = delayed(m, Mux(fits, trial, remainder)[: len(total) + bit + 1], 1)
            quotient = delayed(m, Cat(fits, quotient), 1)
            total = delayed(m, total, 1)
        return quotient


class SubPixel(wiring.Component):
    """Position of each candidate in full-resolution pixels.

    Parameters
    ----------
    level : {0, 1}
        The centre of half-size pixel x is at 2 (x + 1/2) - 1/2 in the full frame.
    lag_px : int
        How far the candidate's pixel is left of and above the scan position.
    spacing_cycles : int
        Smallest distance of two candidates in clocks.
    """

    i: In(CANDIDATE)
    o_x: Out(POSITION.bits)
    """UQ(12, 4), 1/16 px; valid ``latency_cycles`` after the candidate, for at least one clock."""
    o_y: Out(POSITION.bits)
    """As ``o_x``."""

    def __init__(self, *, level: int, lag_px: int, spacing_cycles: int) -> None:
        self.level = level
        self.lag_px = lag_px
        # Where candidates leave time for it, x and y take turns.
        self.turns = min(spacing_cycles, 2)
        self._vertex = Vertex()
        self.latency_cycles = 1 + self._vertex.latency_cycles + self.turns
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """One `Vertex` serves x in the first clock and y in the second; or there is one for each."""
        m = Module()
        m.submodules.vertex = vertex = self._vertex
        up = Signal(RESPONSE_CODE.bits, reset_less=True)
        before = Signal(RESPONSE_CODE.bits, reset_less=True)
        centre = Signal(RESPONSE_CODE.bits, reset_less=True)
        after = Signal(RESPONSE_CODE.bits, reset_less=True)
        down = Signal(RESPONSE_CODE.bits, reset_less=True)
        y_offset: Value = vertex.o_offset
        if self.turns == 1:
            m.submodules.vertex_y = vertex_y = Vertex()
            m.d.comb += [vertex_y.i_before.eq(up), vertex_y.i_centre.eq(centre), vertex_y.i_after.eq(down)]
            y_offset = vertex_y.o_offset
        else:
            # In the clock after a candidate its vertical neighbours move to the inputs of the divider.
            m.d.sync += [before.eq(up), after.eq(down)]
        with m.If(self.i.present):
            m.d.sync += [
                up.eq(self.i.up),
                before.eq(self.i.left),
                centre.eq(self.i.code),
                after.eq(self.i.right),
                down.eq(self.i.down),
            ]
        m.d.comb += [vertex.i_before.eq(before), vertex.i_centre.eq(centre), vertex.i_after.eq(after)]

        x_cycles = 1 + vertex.latency_cycles
        x_done = delayed(m, self.i.present, x_cycles, reset_less=False)
        y_done = delayed(m, x_done, self.turns - 1, reset_less=False)
        column = Signal.like(self.i.x, reset_less=True)
        row = Signal.like(self.i.y, reset_less=True)
        m.d.sync += [column.eq(self.i.x - self.lag_px), row.eq(self.i.y - self.lag_px)]
        x = delayed(m, column, x_cycles - 1)
        y = delayed(m, row, x_cycles + self.turns - 2)
        full_x = port_register(m, self.o_x)
        full_y = port_register(m, self.o_y)
        with m.If(x_done):
            m.d.sync += full_x.eq(self._full_resolution(x, vertex.o_offset))
        with m.If(y_done):
            m.d.sync += full_y.eq(self._full_resolution(y, y_offset))
        return m

    def _full_resolution(self, pixel: Value, offset: Value) -> Value:
        """Level 0: pixel + offset; level 1: 2 (pixel + offset) + 1/2."""
        half = Const(self.level * POSITION.one // 2, POSITION.fraction_bits + self.level)
        return Cat(half, pixel) + (offset << self.level)
