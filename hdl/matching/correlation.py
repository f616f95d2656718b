"""Window correlation in hardware (thesis, equations III-1 to III-3): SAD alone, and a core for SAD, ZSSD and NCC."""

from collections.abc import Sequence
from functools import reduce
from operator import add
from typing import NamedTuple

from amaranth import Array, Cat, Module, Mux, Shape, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.formats import PIXEL
from golden_model.matching.correlation import NCC
from hdl.lib.component import Component
from hdl.lib.delay import delayed

ADDENDS = 3
"""Terms that an adder sums in one clock."""
PIXELS = 9
"""Pixels of a window of `WindowCorrelation`, 3x3."""
WINDOW = data.ArrayLayout(PIXEL.bits, PIXELS)
WINDOWS = data.StructLayout({"left": WINDOW, "right": WINDOW})
_MAX_ENERGY = PIXELS * PIXEL.max_raw**2
_ENERGY, _SQUARE = Shape.cast(range(_MAX_ENERGY + 1)), Shape.cast(range(_MAX_ENERGY**2 + 1))
_PIXEL_CYCLES = 3
"""Clocks from a pixel's selection to its addition to the sums."""
_PHASES = {"Add-Pixels": PIXELS + _PIXEL_CYCLES, "Multiply": _ENERGY.width + 1, "Take-Root": NCC.bits}
"""Clocks of each phase of `WindowCorrelation`."""
SCORES = data.StructLayout(
    {
        "sad": range(PIXELS * PIXEL.max_raw + 1),
        # Largest with four differences of 255, four of -255, and the ninth of either.
        "zssd": range(PIXELS * _MAX_ENERGY - PIXEL.max_raw**2 + 1),
        "ncc": range(NCC.one + 1),
    }
)
"""Units as in `golden_model.matching.correlation`: ``sad``, ``zssd`` (9 times equation III-2), ``ncc`` (UQ1.8)."""


class SumOfAbsoluteDifferences(Component):
    """``o_sum`` = sum of ``|i_left[n] - i_right[n]|``; one pair of windows per clock.

    Parameters
    ----------
    pixels : int
        Pixels of a window.
    """

    i_left: Sequence[Signal]
    i_right: Sequence[Signal]
    o_sum: Signal

    latency_cycles: int
    """From the windows to their sum."""

    def __init__(self, *, pixels: int) -> None:
        terms, self.latency_cycles = pixels, 1
        while terms > 1:
            terms = -(-terms // ADDENDS)
            self.latency_cycles += 1
        window = In(PIXEL.bits).array(pixels)
        super().__init__(i_left=window, i_right=window, o_sum=Out(range(PIXEL.max_raw * pixels + 1)))

    def elaborate(self, platform: object) -> Module:
        """Absolute differences, then a tree of adders with a register after each level."""
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


class _Sums(NamedTuple):
    """Sums over the pixels of two windows: differences, products, and the squares of each window."""

    total: Signal
    product: Signal
    left_energy: Signal
    right_energy: Signal


class WindowCorrelation(wiring.Component):
    """SAD, ZSSD and NCC of two 3x3 windows, one pixel per clock.

    NCC is the largest q with q**2 / 256**2 <= (sum I1 I2)**2 / (sum I1**2 sum I2**2): the exact value rounded down,
    error below 1/256. Both sides are multiplied out, one bit per clock. The bits of q follow, one per clock, as in a
    digit-by-digit square root, where each trial subtracts a multiple of the right side's denominator.
    """

    i: In(stream.Signature(WINDOWS))
    """Accepted together with the scores."""
    o: Out(stream.Signature(SCORES))
    """The scores of the windows at the input."""

    latency_cycles = 1 + sum(_PHASES.values())
    """From ``i.valid`` to ``o.valid``."""

    def elaborate(self, platform: object) -> Module:
        """A state machine, and the arithmetic of its three phases: sums, products, root."""
        m = Module()
        start = Signal()
        step = Signal(range(max(_PHASES.values())))
        adding = Signal()
        multiplying = Signal()
        rooting = Signal()
        following = (*list(_PHASES)[1:], "Offer")
        with m.FSM():
            with m.State("Wait"):
                m.d.comb += start.eq(self.i.valid)
                with m.If(start):
                    m.next = "Add-Pixels"
            for (phase, steps), active, after in zip(
                _PHASES.items(), (adding, multiplying, rooting), following, strict=True
            ):
                with m.State(phase):
                    m.d.comb += active.eq(1)
                    m.d.sync += step.eq(step + 1)
                    with m.If(step == steps - 1):
                        m.d.sync += step.eq(0)
                        m.next = after
            with m.State("Offer"):
                m.d.comb += [self.o.valid.eq(1), self.i.ready.eq(self.o.ready)]
                with m.If(self.o.ready):
                    m.next = "Wait"
        sums = self._sums(m, start, adding, step)
        self._zssd(m, sums)
        square, energy = self._products(m, start, multiplying, step, sums)
        self._root(m, multiplying, rooting, square, energy)
        return m

    def _sums(self, m: Module, start: Value, adding: Value, step: Value) -> _Sums:
        windows = self.i.payload
        left = delayed(m, Array(windows.left)[step[:4]], 1)
        right = delayed(m, Array(windows.right)[step[:4]], 1)
        difference = delayed(m, left - right, 1)
        total = Signal(signed(len(self.o.payload.sad) + 1), reset_less=True)
        product = Signal(_ENERGY, reset_less=True)
        left_energy = Signal(_ENERGY, reset_less=True)
        right_energy = Signal(_ENERGY, reset_less=True)
        addends = (
            (total, difference),
            (self.o.payload.sad, abs(difference)),
            (product, delayed(m, left * right, 1)),
            (left_energy, delayed(m, left * left, 1)),
            (right_energy, delayed(m, right * right, 1)),
        )
        present = delayed(m, adding & (step < PIXELS), _PIXEL_CYCLES - 1, reset_less=False)
        with m.If(start):
            m.d.sync += [register.eq(0) for register, _ in addends]
        with m.Elif(present):
            m.d.sync += [register.eq(register + addend) for register, addend in addends]
        return _Sums(total, product, left_energy, right_energy)

    def _zssd(self, m: Module, sums: _Sums) -> None:
        """Compute 9 times the sum of squared differences minus the square of their sum; ready long before the root."""
        squares = delayed(m, delayed(m, sums.left_energy + sums.right_energy, 1) - (sums.product << 1), 1)
        # A sum of squares is not negative: drop the sign bit.
        times_nine = delayed(m, (squares << 3) + squares, 1)[: len(self.o.payload.zssd)]
        # Yosys 0.70 would take the sum's own register into a DSP48E1, and lose an operand (`hdl.pixel.harris`).
        total = delayed(m, sums.total, 1)
        m.d.sync += self.o.payload.zssd.eq(times_nine - delayed(m, total * total, 2))

    @staticmethod
    def _products(m: Module, start: Value, multiplying: Value, step: Value, sums: _Sums) -> tuple[Signal, Signal]:
        """Multiply the product by itself, and the energies, by shift and add, highest bit first."""
        results = []
        for multiplicand, multiplier in ((sums.product, sums.product), (sums.left_energy, sums.right_energy)):
            result = Signal(_SQUARE, reset_less=True)
            bit = multiplier.bit_select((_ENERGY.width - 1 - step)[: len(step)], 1)
            with m.If(start):
                m.d.sync += result.eq(0)
            with m.Elif(multiplying & (step < _ENERGY.width)):
                m.d.sync += result.eq((result << 1) + Mux(bit, multiplicand, 0))
            results.append(result)
        square, energy = results
        return square, energy

    def _root(self, m: Module, multiplying: Value, rooting: Value, square: Value, energy: Value) -> None:
        """Compute the bits of the root, highest first.

        With Q the bits so far, another 1 leaves the remainder ``remainder - (4 Q + 1) energy``; ``trial`` is the
        subtracted multiple.
        """
        remainder = Signal(_SQUARE.width + NCC.bits + 3, reset_less=True)
        trial = Signal(_SQUARE.width + NCC.bits + 3, reset_less=True)
        quotient = self.o.payload.ncc
        left_over = remainder - trial
        fits = left_over >= 0
        # A black window has energy 0 and product 0; with an energy of 1 the root becomes 0.
        divisor = Mux(energy.any(), energy, 1)
        thrice = delayed(m, (divisor << 1) + divisor, 1)
        with m.If(multiplying):
            m.d.sync += [remainder.eq(square), trial.eq(divisor)]
        with m.Elif(rooting):
            m.d.sync += [
                remainder.eq(Mux(fits, left_over, remainder) << 2),
                trial.eq(Mux(fits, (trial << 1) + thrice, (trial << 1) - divisor)),
                quotient.eq(Cat(fits, quotient)),
            ]
