"""Turns the elements that a program leaves into hypotheses: integers of 25 bits with a common scale."""

from amaranth import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.geometry.fixed_point import ENTRY
from golden_model.geometry.floating import EXPONENT_BITS, MANTISSA_BITS
from golden_model.geometry.program import LANES, REGISTERS
from golden_model.geometry.programs import ELEMENTS, FIRST_ELEMENT, LANE_REGISTERS
from hdl.geometry.floating import FLOAT
from hdl.geometry.match_gain import HYPOTHESIS
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory

MAGNITUDE_BITS = ENTRY.bits - 1
SHIFT_CYCLES = 3


class Quantiser(wiring.Component):
    """Reads the elements of both lanes, one per clock; equal to `golden_model.geometry.estimator.quantise`."""

    i_start: In(1)
    o_register: Out(range(REGISTERS))
    i_number: In(FLOAT)
    """The number in that register, `LineMemory.latency_cycles` clocks later."""
    i_exponents: In(data.ArrayLayout(signed(EXPONENT_BITS), LANES))
    """Largest exponent among each lane's elements."""
    o: Out(data.ArrayLayout(HYPOTHESIS, LANES))
    """They are complete `latency_cycles` after ``i_start``, and stay."""

    # The last element is read, shifted, and moved into its place.
    latency_cycles = LANES * ELEMENTS + LineMemory.latency_cycles + SHIFT_CYCLES + 1

    def elaborate(self, platform: object) -> Module:
        """Read, shift by the distance from the largest exponent, give the sign, move along."""
        m = Module()
        reading = Signal()
        element = Signal(range(ELEMENTS))
        lane = Signal(range(LANES))
        is_last = element == ELEMENTS - 1
        m.d.comb += self.o_register.eq(FIRST_ELEMENT + LANE_REGISTERS * lane + element)
        with m.If(reading):
            m.d.sync += element.eq(Mux(is_last, 0, element + 1))
            with m.If(is_last):
                m.d.sync += [lane.eq(lane + 1), reading.eq(lane != LANES - 1)]
        with m.If(self.i_start):
            m.d.sync += [reading.eq(1), lane.eq(0), element.eq(0)]
        number = self.i_number
        number_lane = delayed(m, lane, LineMemory.latency_cycles)
        dropped = self.i_exponents[number_lane] - number.exponent
        distance = Signal(range(MAGNITUDE_BITS + 1), reset_less=True)
        m.d.sync += distance.eq(Mux(dropped > MAGNITUDE_BITS, MAGNITUDE_BITS, dropped))
        mantissa = delayed(m, number.mantissa[MANTISSA_BITS - MAGNITUDE_BITS :], 1)
        magnitude = delayed(m, mantissa >> distance, 1)
        negative = delayed(m, number.negative, 2)
        entry = Signal(ENTRY.bits, reset_less=True)
        m.d.sync += entry.eq(Mux(negative, -magnitude, magnitude))
        cycles = LineMemory.latency_cycles + SHIFT_CYCLES
        moves = delayed(m, reading, cycles, reset_less=False)
        entry_lane = delayed(m, lane, cycles)
        for n in range(LANES):
            elements = self.o[n].as_value()
            with m.If(moves & (entry_lane == n)):
                m.d.sync += elements.eq(Cat(elements[ENTRY.bits :], entry))
        return m
