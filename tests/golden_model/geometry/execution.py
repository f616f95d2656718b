"""Executes programs of the estimator instruction by instruction, as the hardware does."""

from collections.abc import Mapping

import numpy as np

from golden_model.arrays import Array
from golden_model.geometry.floating import MANTISSA_BITS, Floats
from golden_model.geometry.program import LATENCY_CYCLES, ONE, ZERO, Program, Source


def number(value: float) -> Floats:
    return Floats.from_real(np.array([value]))


def to_real(numbers: Floats) -> Array:
    """The values in double precision."""
    magnitude = np.ldexp(numbers.mantissa.astype(np.float64), numbers.exponent - MANTISSA_BITS)
    return np.where(numbers.negative, -magnitude, magnitude)


def executed(program: Program, registers: Mapping[int, Floats], loads: Mapping[int, Floats]) -> dict[int, Floats]:
    """Registers after the program; a result can be read only after its latency, before it the old number is."""
    numbers = {ZERO: number(0), ONE: number(1), **registers}
    under_way: list[tuple[int, int, Floats]] = []
    clock = 0
    for each in program.instructions:
        for done, register, value in [entry for entry in under_way if entry[0] <= clock]:
            numbers[register] = value
            under_way.remove((done, register, value))
        if each.result:
            a = loads[each.a] if each.source == Source.LOAD else numbers[each.a]
            a = a.seed() if each.source == Source.SEED else a
            c, b = numbers[each.c], numbers[each.b]
            under_way.append((clock + LATENCY_CYCLES, each.result, c.minus(a, b) if each.negate else c.plus(a, b)))
        clock += 1 + each.wait
    assert program.cycles >= max(done for done, *_ in under_way)
    return numbers | {register: value for _, register, value in under_way}
