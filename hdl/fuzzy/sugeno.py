"""Zero-order Sugeno systems, generated from the descriptions in `golden_model.fuzzy.sugeno`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from amaranth import Array, Cat, Const, Module, Mux, ShapeLike, Signal, Value
from amaranth.lib import data, stream
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2, exact_log2

from golden_model.formats import MEMBERSHIP, WEIGHT
from golden_model.fuzzy.sugeno import MAX_RULES, SugenoSystem
from hdl.lib.component import Component
from hdl.lib.delay import delayed, port_register
from hdl.lib.multiplier import Multiplier, multiply

PRODUCT_INPUTS = (2, 3)
PRODUCT_CYCLES = Multiplier.latency_cycles
TERM_CYCLES = PRODUCT_CYCLES + 1
"""A register follows: an adder right behind a multiplier would limit the clock."""
QUOTIENT_BITS = WEIGHT.bits + 1
"""The weighted mean of singletons is at most 1, which is 256."""
RESULT = data.StructLayout({"weight": WEIGHT.bits, "rule": range(MAX_RULES)})
"""Weight in UQ0.8, and the strongest rule, ties to the lowest."""


class Sugeno(Component):
    """Weight and dominant rule of a set of inputs, one rule per clock; equal to `SugenoSystem.evaluate`.

    Membership tables are ROMs. A product system multiplies all degrees but the last and folds the last one into the
    rules' singletons, a second ROM, so that no product is wider than 17 x 17 bits: three multipliers for three
    inputs. A minimum system ends with a division, one quotient bit per clock.

    Parameters
    ----------
    system : SugenoSystem
        A product system has at most 3 inputs.
    value_bits : int
        Width of each input value.

    Raises
    ------
    ValueError
        For a product system of another number of inputs.
    """

    i: stream.Interface
    """Stream of the values, ``ArrayLayout(value_bits, inputs)``. Accepted one clock after the result."""
    o: Out(stream.Signature(RESULT))

    latency_cycles: int
    """From ``i.valid`` to ``o.valid``."""

    def __init__(self, *, system: SugenoSystem, value_bits: int) -> None:
        self.system = system
        self._is_product = system.conjunction == "product"
        inputs = len(system.inputs)
        if self._is_product and inputs not in PRODUCT_INPUTS:
            raise ValueError(f"{system.name}: multiplies {inputs} inputs; valid: {', '.join(map(str, PRODUCT_INPUTS))}")
        # Indices, membership ROM; then operands; products or minima of all but the term's own factor; term.
        combining = (inputs - 2) * PRODUCT_CYCLES if self._is_product else inputs - 1
        self._term_cycles = 1 + combining + TERM_CYCLES
        rounding = 2 if self._is_product else 2 + QUOTIENT_BITS
        self.latency_cycles = 2 + len(system.rules) + self._term_cycles + rounding
        values = data.ArrayLayout(value_bits, inputs)
        super().__init__(i=In(stream.Signature(values)))

    def elaborate(self, platform: object) -> Module:
        """Look up the degrees, evaluate one rule per clock, sum, round; a minimum system divides before rounding."""
        m = Module()
        issuing, rule, last = self._rules(m)
        # Beyond its last entry, a table keeps its last degree.
        indices = [
            delayed(m, Mux(value < variable.entries, value, variable.entries - 1), 1)
            for value, variable in zip(self.i.payload, self.system.inputs, strict=True)
        ]
        degrees = [self._degree(m, n, index, rule) for n, index in enumerate(indices)]
        if self._is_product:
            (strength, term), counted = self._product(m, degrees, self._fold(m, indices[-1], rule)), None
        else:
            strength, counted, term = self._minimum(m, degrees, rule)
        valid = delayed(m, issuing, self._term_cycles, reset_less=False)
        total, fired = self._add_up(m, valid, delayed(m, rule, self._term_cycles), strength, (counted, term))

        ended = delayed(m, last, self._term_cycles + 1, reset_less=False)
        if self._is_product:
            half = self.system.strength_one // 2
            weight = delayed(m, (total + half) >> exact_log2(2 * half), 1)
            finished = ended
        else:
            weight, finished = self._quotient(m, ended, total, fired)
        limited = port_register(m, self.o.payload.weight)
        m.d.sync += limited.eq(Mux(weight > WEIGHT.max_raw, WEIGHT.max_raw, weight))
        with m.If(delayed(m, finished, 1, reset_less=False)):
            m.d.sync += self.o.valid.eq(1)
        with m.Elif(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        return m

    def _rules(self, m: Module) -> tuple[Signal, Signal, Signal]:
        """Count the rules, starting two clocks after ``i.valid``, when the membership ROMs have answered."""
        started = Signal()
        issuing = Signal()
        last = Signal()
        rule = Signal(range(MAX_RULES))
        m.d.comb += last.eq(issuing & (rule == len(self.system.rules) - 1))
        # One start per set of values, which stays until its result has been accepted.
        m.d.sync += [started.eq(self.i.valid & ~self.i.ready), self.i.ready.eq(self.o.valid & self.o.ready)]
        with m.If(delayed(m, self.i.valid & ~self.i.ready & ~started, 1, reset_less=False)):
            m.d.sync += [issuing.eq(1), rule.eq(0)]
        with m.Elif(issuing):
            m.d.sync += [rule.eq(rule + 1), issuing.eq(~last)]
        return issuing, rule, last

    def _degree(self, m: Module, n: int, index: Value, rule: Value) -> Value:
        """Look up the degree of input n in the set that the rule names; 1 where the rule ignores the input."""
        named = {each.sets[n] for each in self.system.rules}
        sets = {name: table for name, table in self.system.inputs[n].sets.items() if name in named}
        if not sets:
            return Const(MEMBERSHIP.one)
        shape = data.ArrayLayout(MEMBERSHIP.bits, len(sets))
        table = [list(map(int, degrees)) for degrees in zip(*sets.values(), strict=True)]
        degrees = dict(zip(sets, _rom(m, f"memberships{n}", shape, table, index), strict=True))
        chosen = [degrees.get(each.sets[n] or "", Const(MEMBERSHIP.one)) for each in self.system.rules]
        return delayed(m, Array(chosen)[rule], 1)

    def _fold(self, m: Module, index: Value, rule: Value) -> Value:
        """Look up the last input's degree times the rule's singleton, in the same clock as `_degree`."""
        *_, variable = self.system.inputs
        rule_bits = ceil_log2(len(self.system.rules))
        table = [0] * (variable.entries << rule_bits)
        for n, each in enumerate(self.system.rules):
            degrees = variable.sets.get(each.sets[-1] or "", np.full(variable.entries, MEMBERSHIP.one))
            for entry, degree in enumerate(degrees):
                table[entry << rule_bits | n] = int(degree) * each.singleton
        shape = range(MEMBERSHIP.one**2 + 1)
        folded: Value = _rom(m, "folded", shape, table, Cat(rule[:rule_bits], index))
        return folded

    def _product(self, m: Module, degrees: list[Value], folded: Value) -> tuple[Value, Value]:
        others, *factors = degrees[:-1]
        last = degrees[-1]
        for n, factor in enumerate(factors):
            others = multiply(m, f"others{n}", others, factor)
            last = delayed(m, last, PRODUCT_CYCLES)
            folded = delayed(m, folded, PRODUCT_CYCLES)
        strength, term = multiply(m, "strength", others, last), multiply(m, "term", others, folded)
        return delayed(m, strength, 1), delayed(m, term, 1)

    def _minimum(self, m: Module, degrees: list[Value], rule: Value) -> tuple[Value, Value | None, Value]:
        """The strength of a rule, what of it counts (None: all), and that times the singleton."""
        strength, *others = degrees
        for n, degree in enumerate(others):
            # The minimum with the nth degree is taken n clocks later.
            waiting = delayed(m, degree, n)
            strength = delayed(m, Mux(waiting < strength, waiting, strength), 1)
        singletons = Array(Const(each.singleton, MEMBERSHIP.bits) for each in self.system.rules)
        singleton = delayed(m, singletons[rule], 1 + len(others))
        if not any(each.joins for each in self.system.rules):
            terms = delayed(m, multiply(m, "term", strength, singleton), 1)
            return delayed(m, strength, TERM_CYCLES), None, terms
        counted = self._excess(m, strength, delayed(m, rule, 1 + len(others)))
        terms = delayed(m, multiply(m, "term", counted, singleton), 1)
        return delayed(m, strength, TERM_CYCLES), delayed(m, counted, TERM_CYCLES), terms

    def _excess(self, m: Module, strength: Value, rule: Value) -> Value:
        """What a rule's strength exceeds those of the rules that it joins by, which come in the clocks before."""
        largest = Signal.like(strength)
        joins = Array(Const(each.joins, 1) for each in self.system.rules)
        before = Mux(joins[rule], largest, 0)
        exceeds = strength > before
        m.d.sync += largest.eq(Mux(exceeds, strength, before))
        return Mux(exceeds, (strength - before)[: len(strength)], 0)

    def _add_up(
        self, m: Module, valid: Value, rule: Value, strength: Value, summed: tuple[Value | None, Value]
    ) -> tuple[Signal, Signal]:
        """Sum what counts of strengths and terms, and keep the dominant rule (ties to the lowest), for one result."""
        counted, term = summed
        # The strengths of a product system sum to one; those of a minimum system may all be 1.
        largest = self.system.strength_one * (1 if self._is_product else len(self.system.rules))
        total = Signal(range(largest * MEMBERSHIP.one + 1))
        fired = Signal(range(largest + 1))
        dominant_strength = Signal.like(strength)
        with m.If(valid):
            m.d.sync += [total.eq(total + term), fired.eq(fired + (strength if counted is None else counted))]
            with m.If(strength > dominant_strength):
                m.d.sync += [dominant_strength.eq(strength), self.o.payload.rule.eq(rule)]
        with m.If(self.i.ready):
            m.d.sync += [total.eq(0), fired.eq(0), dominant_strength.eq(0), self.o.payload.rule.eq(0)]
        return total, fired

    @staticmethod
    def _quotient(m: Module, start: Value, total: Value, fired: Value) -> tuple[Value, Value]:
        """Divide ``total`` by ``fired``, rounded half up, 0 for 0 / 0: one trial subtraction per clock."""
        divisor = Signal(len(fired) + QUOTIENT_BITS, reset_less=True)
        remainder = Signal.like(divisor, reset_less=True)
        quotient = Signal(QUOTIENT_BITS, reset_less=True)
        steps = Signal(range(QUOTIENT_BITS + 1))
        fits = remainder >= divisor
        with m.If(start):
            # (2 total + fired) / (2 fired) rounded down is total / fired rounded half up.
            m.d.sync += [
                divisor.eq(Mux(fired.any(), fired, 1) << QUOTIENT_BITS),
                remainder.eq((total << 1) + fired),
                steps.eq(QUOTIENT_BITS),
            ]
        with m.Elif(steps.any()):
            m.d.sync += [
                divisor.eq(divisor >> 1),
                remainder.eq(Mux(fits, remainder - divisor, remainder)),
                quotient.eq(Cat(fits, quotient)),
                steps.eq(steps - 1),
            ]
        return quotient, steps == 1


def _rom(m: Module, name: str, shape: ShapeLike, table: Sequence[Any], index: Value) -> Any:
    """Read ``table[index]`` within one clock, with the type that ``shape`` gives it."""
    memory: Memory = Memory(shape=shape, depth=len(table), init=table)
    m.submodules[name] = memory
    port = memory.read_port()
    m.d.comb += port.addr.eq(index)
    return port.data
