"""Sums of signals times constants, without multipliers: shifts and a tree of registered adders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from amaranth import Module, Shape, Signal, Value
from amaranth.lib.wiring import In, Out

from hdl.lib.component import Component


def signed_digits(constant: int) -> list[tuple[int, int]]:
    """The shortest list of ``(shift, sign)`` terms, sign 1 or -1, whose sum of ``sign << shift`` is ``constant``.

    This is the canonical signed digit form, e.g. 15 = 16 - 1.
    """
    digits = []
    shift = 0
    while constant:
        if constant & 1:
            # +1 for ...01, -1 for ...11: a run of ones becomes a subtraction from the next power of two.
            sign = 2 - (constant & 3)
            digits.append((shift, sign))
            constant -= sign
        constant >>= 1
        shift += 1
    return digits


@dataclass(frozen=True)
class _Term:
    """``sign * value`` with value in ``low..high``; the sign stays symbolic until two terms meet in an adder."""

    value: Value
    low: int
    high: int
    sign: int

    def plus(self, other: _Term) -> _Term:
        if self.sign == other.sign:
            return _Term(self.value + other.value, self.low + other.low, self.high + other.high, self.sign)
        plus, minus = (self, other) if self.sign > 0 else (other, self)
        return _Term(plus.value - minus.value, plus.low - minus.high, plus.high - minus.low, 1)


class WeightedSum(Component):
    """``o_sum`` = sum of ``weights[n] * i_values[n]``, one set of values per clock.

    Parameters
    ----------
    weights : sequence of int
        Constant weight of each value, positive or negative; 0 leaves the value out.
    shape : Shape
        Shape of the values.

    Raises
    ------
    ValueError
        If every weight is 0.
    """

    i_valid: Signal
    """There are values; without, the adders keep theirs."""
    i_values: Sequence[Signal]
    o_valid: Signal
    o_sum: Signal
    """The sum, just wide enough for its range."""

    latency_cycles: int
    """Clocks from values to sum: the depth of the tree of two-operand adders."""
    low: int
    """Smallest sum."""
    high: int
    """Largest sum."""

    def __init__(self, *, weights: Sequence[int], shape: Shape) -> None:
        if not any(weights):
            raise ValueError(f"weights are {list(weights)}; at least one must not be 0")
        self.weights = tuple(weights)
        lowest = -(1 << shape.width - 1) if shape.signed else 0
        self._extremes = extremes = (lowest, lowest + (1 << shape.width) - 1)
        self.low = sum(min(weight * extreme for extreme in extremes) for weight in weights)
        self.high = sum(max(weight * extreme for extreme in extremes) for weight in weights)
        terms = sum(len(signed_digits(weight)) for weight in weights)
        self.latency_cycles = max((terms - 1).bit_length(), 1)
        super().__init__(
            i_valid=In(1),
            i_values=In(shape).array(len(weights)),
            o_valid=Out(1),
            o_sum=Out(Shape.cast(range(self.low, self.high + 1))),
        )

    def elaborate(self, platform: object) -> Module:
        """Build the tree of adders."""
        m = Module()
        low, high = self._extremes
        # A tree and not sum(), which would widen every step by a bit. Sorted by shift, terms of similar size meet in
        # the first adders, which stay narrow.
        digits = sorted(
            (shift, sign, n) for n, weight in enumerate(self.weights) for shift, sign in signed_digits(weight)
        )
        terms = [_Term(self.i_values[n] << shift, low << shift, high << shift, sign) for shift, sign, n in digits]
        valid: Value = self.i_valid
        for level in range(self.latency_cycles):
            # An odd term out passes through a register, so that all terms stay in step.
            sums = [a.plus(b) for a, b in zip(terms[0::2], terms[1::2], strict=False)] + terms[len(terms) & ~1 :]
            terms = [self._register(m, valid, term, f"level{level}_term{n}") for n, term in enumerate(sums)]
            registered_valid = Signal(name=f"level{level}_valid")
            m.d.sync += registered_valid.eq(valid)
            valid = registered_valid
        (total,) = terms
        # A term keeps its sign apart; a sum of negative terms alone still has it here.
        m.d.comb += [self.o_valid.eq(valid), self.o_sum.eq(total.value if total.sign > 0 else -total.value)]
        return m

    @staticmethod
    def _register(m: Module, valid: Value, term: _Term, name: str) -> _Term:
        register = Signal(range(term.low, term.high + 1), name=name, reset_less=True)
        with m.If(valid):
            m.d.sync += register.eq(term.value)
        return _Term(register, term.low, term.high, term.sign)
