"""The Harris corner measure (thesis, equations III-6 and III-7), pipelined for DSP slices."""

from amaranth import Cat, Const, Module, Mux, Shape, Value, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import check_choice
from golden_model.formats import (
    GRADIENT,
    RAW_RESPONSE,
    RESPONSE_CODE,
    RESPONSE_FRACTION_BITS,
    TENSOR_DIAGONAL,
    TENSOR_MIXED,
    TENSOR_TRACE,
)
from golden_model.pixel.harris import TENSOR_SHIFT
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.multiplier import Multiplier, multiply
from hdl.lib.weighted_sum import signed_digits
from hdl.pixel.window import SeparableSum
from hdl.streams import beat, carry_scan, pixelwise

GRADIENTS = data.StructLayout({"x": signed(GRADIENT.bits), "y": signed(GRADIENT.bits)})
TENSOR_LINES = 5
"""Lines of the largest window, at least 5; a smaller window lies in the middle of it."""
TENSOR = {"a": TENSOR_DIAGONAL.bits, "b": TENSOR_DIAGONAL.bits, "c": signed(TENSOR_MIXED.bits)}
"""The structure tensor: sums of Ix**2, Iy**2 and Ix Iy."""


class StructureTensor(Component):
    """Sums of gradient products over a box, ``>> 8`` (floor).

    The line memories in front of this block store gradients (22 bits per pixel), and the products are formed again
    for the whole column in every clock: storing products would take 61 bits per pixel.

    Parameters
    ----------
    window_px : {3, 5}
    """

    i: data.View
    """Beats of ``column``: `GRADIENTS` of 5 pixels, the newest line first."""
    o: data.View
    """Beats of `TENSOR`."""

    lag_px = TENSOR_LINES // 2

    def __init__(self, *, window_px: int, pixels_per_clock: int = 1) -> None:
        check_choice("window_px", window_px, (3, 5))
        self.window_px = window_px
        self.pixels_per_clock = pixels_per_clock
        square, mixed = unsigned(2 * GRADIENT.bits - 2), signed(2 * GRADIENT.bits - 1)
        self._sums = [self._box_sum(shape) for shape in (square, square, mixed)]
        self.latency_cycles = Multiplier.latency_cycles + self._sums[0].latency_cycles
        column = data.ArrayLayout(GRADIENTS, TENSOR_LINES)
        super().__init__(i=In(beat(pixels_per_clock, column=column)), o=Out(beat(pixels_per_clock, **TENSOR)))

    def _box_sum(self, product: Shape) -> SeparableSum:
        # Zero weights around a smaller window keep its centre, and so the lag, the same.
        outside = (0,) * ((TENSOR_LINES - self.window_px) // 2)
        weights = (*outside, *(1,) * self.window_px, *outside)
        return SeparableSum(vertical=weights, horizontal=weights, shape=product, pixels_per_clock=self.pixels_per_clock)

    def elaborate(self, platform: object) -> Module:
        """A column of products and its sums."""
        m = Module()
        carry_scan(m, self.i, self.o, self.latency_cycles)
        product_valid = delayed(m, self.i.valid, Multiplier.latency_cycles, reset_less=False)
        for name, factors, total in zip("abc", ("xx", "yy", "xy"), self._sums, strict=True):
            m.submodules[f"sum_{name}"] = total
            m.d.comb += total.i.valid.eq(product_valid)
            for target, source in pixelwise(self.pixels_per_clock, self.o[name], total.o.sum):
                m.d.comb += target.eq(source >> TENSOR_SHIFT)
            columns = pixelwise(self.pixels_per_clock, self.i.column, total.i.column)
            pairs = [pair for column, products in columns for pair in zip(column, products, strict=True)]
            for n, (gradients, pixel) in enumerate(pairs):
                a, b = gradients[factors[0]], gradients[factors[1]]
                product = Multiplier(a=a.shape(), b=b.shape(), product=pixel.shape())
                m.submodules[f"product_{name}{n}"] = product
                m.d.comb += [
                    product.i_valid.eq(self.i.valid),
                    product.i_a.eq(a),
                    product.i_b.eq(b),
                    pixel.eq(product.o_product),
                ]
        return m


class RawResponse(wiring.Component):
    """``R = A B - C**2 - ((k_numerator (A + B)**2) >> k_shift)`` (floor).

    R fits 32 bits (proved in `golden_model.pixel.harris`), so everything is computed modulo 2**32 without saturation.

    Parameters
    ----------
    k_numerator, k_shift : int
        k = k_numerator / 2**k_shift, below 1/4.
    """

    i: In(beat(**TENSOR))
    """The structure tensor of one pixel."""
    o: Out(beat(raw=signed(RAW_RESPONSE.bits)))
    """`golden_model.formats.RAW_RESPONSE`."""

    latency_cycles = 1 + Multiplier.latency_cycles + 1

    def __init__(self, *, k_numerator: int, k_shift: int) -> None:
        self.k_numerator = k_numerator
        self.k_shift = k_shift
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """One clock each: operands, multipliers, products, determinant, response; the trace is a clock behind."""
        m = Module()
        carry_scan(m, self.i, self.o, self.latency_cycles)
        valid, a, b, c = self.i.valid, self.i.a, self.i.b, self.i.c
        # The trace fits 17 bits (proved), so its square takes one DSP slice; slicing drops the carry that never occurs.
        # It has a register before the multiplier's own: Yosys 0.70 would take the sum into the pre-adder of a DSP48E1,
        # which feeds one operand only, and leave the other one 0 (docs/reference/results.md).
        trace = delayed(m, (a + b)[: TENSOR_TRACE.bits], 1)
        trace_valid = delayed(m, valid, 1, reset_less=False)
        a_b, c_c = multiply(m, "a_b", a, b, valid=valid), multiply(m, "c_c", c, c, valid=valid)
        determinant = delayed(m, (a_b - c_c)[: RAW_RESPONSE.bits], 1)
        penalty = self._penalty(multiply(m, "trace", trace, trace, valid=trace_valid))
        m.d.comb += self.o.raw.eq(delayed(m, (determinant - penalty)[: RAW_RESPONSE.bits], 1))
        return m

    def _penalty(self, trace_squared: Value) -> Value:
        scaled: Value = Const(0)
        for shift, sign in signed_digits(self.k_numerator):
            term = trace_squared << shift
            scaled = scaled + term if sign > 0 else scaled - term
        return (scaled >> self.k_shift)[: RAW_RESPONSE.bits]


class ResponseCode(wiring.Component):
    """Compresses responses to the 15-bit codes in which they are stored; 0 below the threshold."""

    i: In(beat(raw=signed(RAW_RESPONSE.bits)))
    """The response of one pixel."""
    i_threshold_code: In(RESPONSE_CODE.bits)
    """Smallest code that survives. Stable during a frame."""
    o: Out(beat(code=RESPONSE_CODE.bits))
    """`golden_model.formats.RESPONSE_CODE`."""

    latency_cycles = 6

    def elaborate(self, platform: object) -> Module:
        """Shift right until 11 bits are left, put the number of shifts in front, compare with the threshold."""
        m = Module()
        carry_scan(m, self.i, self.o, self.latency_cycles)
        # Without the sign: negative responses become 0 at the end.
        value: Value = self.i.raw[: RAW_RESPONSE.bits - 1]
        exponent: Value = Cat()
        for steps in ((16,), (8,), (4,), (2, 1)):
            value, exponent = self._normalise(m, value, exponent, steps)
        # The hidden one just above the fraction adds 1 to the exponent field: the field of a normal number is its
        # number of shifts plus one.
        code = delayed(m, ((exponent << RESPONSE_FRACTION_BITS) + value)[: RESPONSE_CODE.bits], 1)
        negative = delayed(m, self.i.raw < 0, self.latency_cycles - 1)
        m.d.comb += self.o.code.eq(delayed(m, Mux(negative | (code < self.i_threshold_code), 0, code), 1))
        return m

    @staticmethod
    def _normalise(m: Module, value: Value, exponent: Value, steps: tuple[int, ...]) -> tuple[Value, Value]:
        """One clock of conditional shifts, the largest first; ``exponent`` records which were made."""
        for step in steps:
            kept_bits = RESPONSE_FRACTION_BITS + step
            too_long = value[kept_bits:].any()
            value = Mux(too_long, value >> step, value)[:kept_bits]
            exponent = Cat(too_long, exponent)
        return delayed(m, value, 1), delayed(m, exponent, 1)
