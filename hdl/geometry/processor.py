"""Runs the estimator's programs: instructions, registers, and the one floating-point operation."""

from typing import Any

from amaranth import Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from golden_model.formats import POSITION, WEIGHT
from golden_model.geometry.floating import EXPONENT_BITS, MANTISSA_BITS, MIN_EXPONENT
from golden_model.geometry.program import (
    LANES,
    LATENCY_CYCLES,
    MAX_WAIT,
    ONE,
    REGISTERS,
    SLOTS,
    ZERO,
    Coordinate,
    Source,
)
from golden_model.geometry.programs import FIRST_ELEMENT, LANE_REGISTERS, PROGRAMS
from golden_model.geometry.solving import MIN_CHECKED_EXPONENT
from hdl.geometry.floating import FLOAT, MultiplyAdd, seed
from hdl.geometry.match_gain import PAIR, WEIGHED_PAIR
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.lib.views import view_signal

INSTRUCTION = data.StructLayout(
    {
        "source": len(Source).bit_length(),
        "a": range(REGISTERS),
        "b": range(REGISTERS),
        "c": range(REGISTERS),
        "result": range(REGISTERS),
        "negate": 1,
        "checks": LANES,
        "wait": range(MAX_WAIT + 1),
    }
)
CONSTANTS: dict[int, Any] = {
    ZERO: {"mantissa": 0, "exponent": MIN_EXPONENT, "negative": 0},
    ONE: {"mantissa": 1 << MANTISSA_BITS - 1, "exponent": 1, "negative": 0},
}
OPERAND_CYCLES = LineMemory.latency_cycles + 1
"""From an instruction to its operands at the arithmetic."""
assert OPERAND_CYCLES + MultiplyAdd.latency_cycles + 1 == LATENCY_CYCLES


class Processor(wiring.Component):
    """Runs `golden_model.geometry.programs`, an instruction per clock, and reads the elements that they leave.

    There is no interlock: the programs are scheduled.
    """

    i_start: In(1)
    """Runs ``i_program``; not while ``o_busy``, nor in the first two clocks, which write the constants."""
    i_program: In(range(len(PROGRAMS)))
    o_busy: Out(1)
    """From the clock after ``i_start`` until the last result is stored."""
    o_slot: Out(range(SLOTS))
    """Slot of the match whose coordinate is loaded."""
    i_match: In(WEIGHED_PAIR)
    """That match, `LineMemory.latency_cycles` clocks later."""
    i_centre: In(data.ArrayLayout(unsigned(POSITION.bits), 2))
    """Centre of the frame, 1/16 px."""
    o_passed: Out(LANES)
    """Whether all checks of each lane have been passed in this program."""
    i_register: In(range(REGISTERS))
    """A register to read while no program runs."""
    o_register: Out(FLOAT)
    """Its number, `LineMemory.latency_cycles` clocks later."""
    o_exponents: Out(data.ArrayLayout(signed(EXPONENT_BITS), LANES))
    """Largest exponent among each lane's elements."""

    start_cycles = 3
    """From ``i_start`` to the first instruction."""

    def elaborate(self, platform: object) -> Module:
        """Fetch, read, load or approximate, compute, store and check."""
        m = Module()
        instruction, issued = self._fetch(m)
        m.submodules.arithmetic = arithmetic = MultiplyAdd()
        result = view_signal(FLOAT)
        stored = delayed(m, Mux(issued, instruction.result, ZERO), LATENCY_CYCLES - 1, reset_less=False)
        # Nothing else is ever written to the registers of the constants. They are restored between programs, which read
        # them in most clocks: what `LineMemory` reads while it is written is unspecified.
        constant = Signal()
        m.d.sync += constant.eq(~constant)
        operands: list[Any] = []
        for name in "abc":
            m.submodules[f"registers_{name}"] = registers = LineMemory(shape=FLOAT, depth=REGISTERS)
            address = Mux(self.o_busy, instruction[name], self.i_register) if name == "a" else instruction[name]
            m.d.comb += [
                registers.i_read.eq(1),
                registers.i_read_address.eq(address),
                registers.i_write.eq(~self.o_busy | (stored != ZERO)),
                registers.i_write_address.eq(Mux(self.o_busy, stored, Mux(constant, ONE, ZERO))),
                registers.i_word.eq(result),
            ]
            operands.append(registers.o_word)
        m.d.comb += [result.eq(arithmetic.o), self.o_register.eq(operands[0])]
        with m.If(~self.o_busy):
            m.d.comb += result.eq(Mux(constant, FLOAT.const(CONSTANTS[ONE]), FLOAT.const(CONSTANTS[ZERO])))
        a = view_signal(FLOAT, reset_less=True)
        m.d.sync += a.eq(self._choose(m, instruction, operands[0]))
        m.d.comb += [
            arithmetic.i_a.eq(a),
            arithmetic.i_b.eq(delayed(m, operands[1], 1)),
            arithmetic.i_c.eq(delayed(m, operands[2], 1)),
            arithmetic.i_negate.eq(delayed(m, instruction.negate, OPERAND_CYCLES)),
        ]
        checks = delayed(m, Mux(issued, instruction.checks, 0), LATENCY_CYCLES - 1, reset_less=False)
        self._observe(m, arithmetic.o, stored, checks)
        return m

    def _fetch(self, m: Module) -> tuple[data.View, Signal]:
        """The instruction, and whether this is its clock."""
        words = [each for program in PROGRAMS for each in program.instructions]
        fields = INSTRUCTION.members
        memory: Memory = Memory(
            shape=INSTRUCTION,
            depth=len(words),
            init=[{name: int(getattr(each, name)) for name in fields} for each in words],
        )
        m.submodules.program = memory
        starts = [sum(len(each.instructions) for each in PROGRAMS[:n]) for n in range(len(PROGRAMS))]
        read = memory.read_port()
        address = Signal(range(len(words) + 1))
        left = Signal(range(max(len(each.instructions) for each in PROGRAMS) + 1))
        fetched = Signal()
        issued = Signal()
        instruction = view_signal(INSTRUCTION, reset_less=True)
        wait = Signal(range(MAX_WAIT + 1))
        # Clocks until the last result can be read.
        draining = Signal(range(LATENCY_CYCLES + MAX_WAIT + 1))
        take = wait == 0
        m.d.comb += [read.addr.eq(address), read.en.eq(take), self.o_busy.eq(draining != 0)]
        m.d.sync += issued.eq(take & fetched)
        with m.If(take):
            m.d.sync += [instruction.eq(read.data), fetched.eq(left != 0)]
            with m.If(fetched):
                m.d.sync += wait.eq(read.data.wait)
            with m.If(left != 0):
                m.d.sync += [address.eq(address + 1), left.eq(left - 1)]
        with m.Else():
            m.d.sync += wait.eq(wait - 1)
        with m.If((left != 0) | fetched):
            m.d.sync += draining.eq(LATENCY_CYCLES)
        with m.Elif(self.o_busy):
            m.d.sync += draining.eq(draining - 1)
        with m.If(self.i_start):
            m.d.sync += draining.eq(LATENCY_CYCLES)
            with m.Switch(self.i_program):
                for n, (start, program) in enumerate(zip(starts, PROGRAMS, strict=True)):
                    with m.Case(n):
                        m.d.sync += [address.eq(start), left.eq(len(program.instructions))]
        return instruction, issued

    def _choose(self, m: Module, instruction: data.View, register: data.View) -> Value:
        """Choose the first factor: a register's number, its approximate reciprocal, or a coordinate."""
        selected = (SLOTS - 1).bit_length()
        m.d.comb += self.o_slot.eq(instruction.a[selected:])
        coordinate = delayed(m, instruction.a[:selected], LineMemory.latency_cycles)
        source = delayed(m, instruction.source, LineMemory.latency_cycles)
        loaded = Signal(MANTISSA_BITS)
        with m.Switch(coordinate):
            for each, name in zip(Coordinate, PAIR.members, strict=False):
                with m.Case(each):
                    m.d.comb += loaded.eq(self.i_match.pair[name] << MANTISSA_BITS - POSITION.bits)
            with m.Case(Coordinate.WEIGHT):
                m.d.comb += loaded.eq(self.i_match.weight << MANTISSA_BITS - WEIGHT.bits)
            for each, centre in zip((Coordinate.CENTRE_X, Coordinate.CENTRE_Y), self.i_centre, strict=True):
                with m.Case(each):
                    m.d.comb += loaded.eq(centre << MANTISSA_BITS - POSITION.bits)
        chosen = view_signal(FLOAT)
        with m.Switch(source):
            with m.Case(Source.REGISTER):
                m.d.comb += chosen.eq(register)
            with m.Case(Source.SEED):
                m.d.comb += chosen.as_value().eq(seed(register))
            with m.Case(Source.LOAD):
                m.d.comb += chosen.mantissa.eq(loaded)
        return Value.cast(chosen)

    def _observe(self, m: Module, result: data.View, stored: Value, checks: Value) -> None:
        """Keep the checks, and each lane's largest exponent."""
        passes = ~result.negative & (result.exponent >= MIN_CHECKED_EXPONENT)
        with m.If(self.i_start):
            m.d.sync += self.o_passed.eq(~0)
        with m.Else():
            m.d.sync += self.o_passed.eq(self.o_passed & ~Mux(passes, 0, checks))
        for lane, largest in enumerate(self.o_exponents):
            is_element = stored // LANE_REGISTERS == FIRST_ELEMENT // LANE_REGISTERS + lane
            with m.If(self.i_start):
                m.d.sync += largest.eq(MIN_EXPONENT)
            with m.Elif(is_element & (result.exponent > largest)):
                m.d.sync += largest.eq(result.exponent)
