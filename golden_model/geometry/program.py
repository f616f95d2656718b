"""Straight-line programs of the one operation of `golden_model.geometry.floating`, scheduled once for the hardware.

A formula written for `golden_model.geometry.floating.Number` is traced: it runs on `Value` instead of numbers, and its
operations become instructions. Each instruction is issued in its clock; its result can be read `LATENCY_CYCLES` later.
List scheduling issues the operation with the longest way to the end first, and nothing where none is ready, so the
hardware needs no interlock, and a program takes the same number of clocks for any data.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Self

LATENCY_CYCLES = 16
"""From an instruction to the first one that may use its result; see `hdl.geometry.processor`."""
REGISTERS = 128
ZERO, ONE = 0, 1
"""Registers that always hold these numbers."""
LANES = 2
"""Samples that are solved together, so that operations of one fill the waits of the other."""
SLOTS = 8
"""Matches whose positions a program can load."""
MAX_WAIT = 7
"""The most that the three bits of ``Instruction.wait`` hold."""


class Source(enum.IntEnum):
    """What the factor a of an instruction is."""

    REGISTER = 0
    SEED = 1
    LOAD = 2


class Coordinate(enum.IntEnum):
    """What an instruction loads from a slot's match; the centre is the same for all slots."""

    LEFT_X = 0
    LEFT_Y = 1
    RIGHT_X = 2
    RIGHT_Y = 3
    WEIGHT = 4
    CENTRE_X = 5
    CENTRE_Y = 6


@dataclass(frozen=True)
class Instruction:
    """result = register c + a x register b, or c minus it; ``a`` is a register, or for a load 8 slot + coordinate.

    An instruction whose result is the register `ZERO` does nothing.
    """

    source: Source = Source.REGISTER
    a: int = ZERO
    b: int = ZERO
    c: int = ZERO
    result: int = ZERO
    negate: bool = False
    checks: int = 0
    """Bits of the lanes whose sample is dropped unless the result is positive and large enough."""
    wait: int = 0
    """Clocks without an instruction after this one."""


@dataclass(eq=False)
class Value:
    """A number in a program: loaded, in a named register, or the result of an operation on others."""

    operands: tuple[Value, ...] = ()
    """a, b, c of an operation."""
    source: Source = Source.REGISTER
    negate: bool = False
    register: int | None = None
    load: int | None = None
    checks: int = 0
    height: int = field(default=0, init=False)
    """Clocks from its issue to the end of what depends on it."""

    def plus(self, a: Self, b: Self) -> Value:
        """This + ``a`` ``b``."""
        return _operation(self, a, b, negate=False)

    def minus(self, a: Self, b: Self) -> Value:
        """This - ``a`` ``b``."""
        return _operation(self, a, b, negate=True)

    def seed(self) -> Value:
        """Approximate the reciprocal."""
        return Value((self, _ONE, _ZERO), Source.SEED)


def _operation(c: Value, a: Value, b: Value, *, negate: bool) -> Value:
    # Only the first factor can be loaded.
    a, b = (b, a) if b.load is not None else (a, b)
    return Value((a, b, c), Source.REGISTER if a.load is None else Source.LOAD, negate)


_ZERO, _ONE = Value(register=ZERO), Value(register=ONE)


def constants() -> tuple[Value, Value]:
    """The numbers 0 and 1."""
    return _ZERO, _ONE


def loaded(slot: int, coordinate: Coordinate) -> Value:
    """A coordinate of the match in a slot."""
    return Value(load=slot * SLOTS + coordinate)


def held(register: int) -> Value:
    """What an earlier program left in a register."""
    return Value(register=register)


@dataclass(frozen=True)
class Program:
    """Instructions in their order."""

    instructions: tuple[Instruction, ...]

    @property
    def cycles(self) -> int:
        """Clocks from the first instruction until the last result can be read."""
        return sum(1 + each.wait for each in self.instructions) - 1 + LATENCY_CYCLES


def schedule(results: Sequence[tuple[int, Value]], checks: Sequence[tuple[int, Value]] = (), *, first: int) -> Program:
    """Schedule a program.

    Parameters
    ----------
    results : sequence of (int, Value)
        Registers in which to leave values.
    checks : sequence of (int, Value)
        Lanes, and the values that must be positive and large enough in each.
    first : int
        First of the registers that are free for intermediate values.

    Raises
    ------
    ValueError
        If these are not enough.
    """
    for lane, value in checks:
        value.checks |= 1 << lane
    order = list(_operations([value for _, value in (*results, *checks)]))
    users: dict[Value, int] = {}
    for value in reversed(order):
        for operand in value.operands:
            operand.height = max(operand.height, value.height + LATENCY_CYCLES)
            users[operand] = users.get(operand, 0) + 1
    target = {value: register for register, value in results}
    free = list(range(REGISTERS - 1, first - 1, -1))
    place: dict[Value, int] = {}
    ready: dict[Value, int] = {}
    waiting = sorted(order, key=lambda value: -value.height)
    instructions: list[Instruction] = []
    while waiting:
        clock = len(instructions)
        issued = next(
            (v for v in waiting if all(not o.operands or ready.get(o, clock + 1) <= clock for o in v.operands)), None
        )
        if issued is None:
            instructions.append(Instruction())
            continue
        waiting.remove(issued)
        ready[issued] = clock + LATENCY_CYCLES
        a, b, c = (_read(operand, place) for operand in issued.operands)
        for operand in issued.operands:
            users[operand] -= 1
            if operand in place and not users[operand] and operand not in target:
                free.append(place[operand])
        if issued not in target and not free:
            raise ValueError(f"{REGISTERS - first} registers are not enough")
        place[issued] = target[issued] if issued in target else free.pop()
        instructions.append(Instruction(issued.source, a, b, c, place[issued], issued.negate, issued.checks))
        # Nobody reads what is only checked.
        if issued not in target and not users.get(issued):
            free.append(place[issued])
    return Program(_with_waits(instructions))


def _with_waits(instructions: list[Instruction]) -> tuple[Instruction, ...]:
    """Replace instructions that do nothing by waits, as far as these go."""
    shortened: list[Instruction] = []
    for each in instructions:
        if each.result == ZERO and shortened and shortened[-1].wait < MAX_WAIT:
            shortened[-1] = dataclasses.replace(shortened[-1], wait=shortened[-1].wait + 1)
        else:
            shortened.append(each)
    return tuple(shortened)


def _operations(results: Sequence[Value]) -> Iterator[Value]:
    """Every operation that the results need, after those that it needs itself."""
    seen: set[Value] = set()

    def visit(value: Value) -> Iterator[Value]:
        if value not in seen and value.operands:
            seen.add(value)
            for operand in value.operands:
                yield from visit(operand)
            yield value

    for result in results:
        yield from visit(result)


def _read(operand: Value, place: dict[Value, int]) -> int:
    if operand.load is not None:
        return operand.load
    return place[operand] if operand.register is None else operand.register
