"""The floating-point operation of the estimator, c + ab or c - ab, one per clock."""

from amaranth import Array, Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.geometry.floating import (
    EXPONENT_BITS,
    MANTISSA_BITS,
    MAX_EXPONENT,
    MIN_EXPONENT,
    SEED_BITS,
    SEED_INDEX_BITS,
    SEEDS,
    SUM_BITS,
)
from hdl.lib.delay import delayed, port_register
from hdl.lib.multiplier import Multiplier, multiply

FLOAT = data.StructLayout({"mantissa": MANTISSA_BITS, "exponent": signed(EXPONENT_BITS), "negative": 1})
"""See `golden_model.geometry.floating.Floats`."""
HALF_BITS = MANTISSA_BITS // 2
TERM_BITS = MANTISSA_BITS + 1
"""Magnitude of a product, and of the c that is added to it."""
COARSE_BITS = 8
"""Shifts are made in two steps: by multiples of 8, and by less."""
PRODUCT_CYCLES = Multiplier.latency_cycles + 2


class MultiplyAdd(wiring.Component):
    """``o`` = ``i_c`` + ``i_a`` ``i_b``, or minus the product; equal to `golden_model.geometry.floating`.

    Four multipliers of 16 x 16 bits.
    """

    i_a: In(FLOAT)
    i_b: In(FLOAT)
    i_c: In(FLOAT)
    i_negate: In(1)
    o: Out(FLOAT)

    # Product; two steps of alignment; sum; its magnitude; two steps of normalisation; limits of the exponent.
    latency_cycles = PRODUCT_CYCLES + 2 + 1 + 1 + 2 + 1

    def elaborate(self, platform: object) -> Module:
        """Multiply, align, add, normalise. No register has a reset or waits."""
        m = Module()
        product = self._multiply(m)
        addend = delayed(m, Cat(Const(0, 1), self.i_c.mantissa), PRODUCT_CYCLES)
        exponent, product_shift, addend_shift = self._compare_exponents(m)
        aligned = _shift_right(m, product, product_shift)
        aligned_addend = _shift_right(m, addend, addend_shift)
        sum_cycles = PRODUCT_CYCLES + 2
        negative = delayed(m, self.i_a.negative ^ self.i_b.negative ^ self.i_negate, sum_cycles)
        differs = delayed(m, self.i_a.negative ^ self.i_b.negative ^ self.i_negate ^ self.i_c.negative, sum_cycles)
        total = Signal(signed(SUM_BITS + 1), reset_less=True)
        m.d.sync += total.eq(Mux(differs, aligned - aligned_addend, aligned + aligned_addend))
        magnitude = Signal(SUM_BITS, reset_less=True)
        m.d.sync += magnitude.eq(Mux(total < 0, -total, total))
        is_negative = delayed(m, delayed(m, negative, 1) ^ (total < 0), 1)
        self._normalise(m, magnitude, delayed(m, exponent, 2), is_negative)
        return m

    def _multiply(self, m: Module) -> Value:
        """The 33 leading bits of the product of the mantissas."""
        halves = [(each.mantissa[:HALF_BITS], each.mantissa[HALF_BITS:]) for each in (self.i_a, self.i_b)]
        pairs = [(a, b) for a in halves[0] for b in halves[1]]
        products = [multiply(m, f"multiplier{n}", a, b) for n, (a, b) in enumerate(pairs)]
        low, *cross, high = products
        middle = delayed(m, cross[0] + cross[1], 1)
        outer = delayed(m, Cat(low, high), 1)
        whole = Signal(2 * MANTISSA_BITS)
        m.d.comb += whole.eq(Cat(outer[:HALF_BITS], outer[HALF_BITS:] + middle))
        return delayed(m, whole[MANTISSA_BITS - 1 :], 1)

    def _compare_exponents(self, m: Module) -> tuple[Value, Value, Value]:
        """The larger exponent, after the alignment; the shifts of product and c, before it."""
        product = delayed(m, self.i_a.exponent + self.i_b.exponent, 1)
        addend = delayed(m, self.i_c.exponent, 1)
        distance = delayed(m, product - addend, 1)
        larger = delayed(m, Mux(product < addend, addend, product), 1)
        shifts: list[Value] = []
        for excess in (-distance, distance):
            shift = Signal(range(TERM_BITS + 1), name=f"shift{len(shifts)}", reset_less=True)
            m.d.sync += shift.eq(Mux(excess < 0, 0, Mux(excess > TERM_BITS, TERM_BITS, excess)))
            shifts.append(delayed(m, shift, PRODUCT_CYCLES - 3))
        return delayed(m, larger, PRODUCT_CYCLES), shifts[0], shifts[1]

    def _normalise(self, m: Module, magnitude: Signal, exponent: Value, negative: Value) -> None:
        """Shift until the leading bit is set, and limit the exponent."""
        coarse = Signal(range(SUM_BITS), init=SUM_BITS // COARSE_BITS * COARSE_BITS)
        for shift in reversed(range(0, coarse.init, COARSE_BITS)):
            with m.If(magnitude[SUM_BITS - shift - COARSE_BITS : SUM_BITS - shift].any()):
                m.d.comb += coarse.eq(shift)
        shifted = delayed(m, (magnitude << coarse)[:SUM_BITS], 1)
        before_fine = delayed(m, exponent + 1 - coarse, 1)
        fine = Signal(range(COARSE_BITS))
        for shift in reversed(range(COARSE_BITS)):
            with m.If(shifted[SUM_BITS - 1 - shift]):
                m.d.comb += fine.eq(shift)
        mantissa = delayed(m, (shifted << fine)[SUM_BITS - MANTISSA_BITS : SUM_BITS], 1)
        normalised = delayed(m, before_fine - fine, 1)
        is_zero = ~mantissa[-1] | (normalised < MIN_EXPONENT)
        result = port_register(m, self.o)
        is_negative = delayed(m, negative, 2)
        m.d.sync += [
            result.mantissa.eq(Mux(is_zero, 0, mantissa)),
            result.exponent.eq(Mux(is_zero, MIN_EXPONENT, Mux(normalised > MAX_EXPONENT, MAX_EXPONENT, normalised))),
            result.negative.eq(is_negative),
        ]


def seed(value: data.View) -> Value:
    """The approximate reciprocal of a normalised number, with the bits of `FLOAT`."""
    table = Array(Const(each, SEED_BITS) for each in SEEDS)
    index = value.mantissa[MANTISSA_BITS - 1 - SEED_INDEX_BITS : MANTISSA_BITS - 1]
    exponent = 1 - value.exponent
    limited = Mux(exponent > MAX_EXPONENT, MAX_EXPONENT, exponent)[:EXPONENT_BITS]
    return Cat(Const(0, MANTISSA_BITS - SEED_BITS), table[index], limited, value.negative)


def _shift_right(m: Module, value: Value, shift: Value) -> Value:
    """Shift in two clocks."""
    fine_bits = (COARSE_BITS - 1).bit_length()
    coarse = delayed(m, value >> (shift[fine_bits:] << fine_bits), 1)
    return delayed(m, coarse >> delayed(m, shift[:fine_bits], 1), 1)
