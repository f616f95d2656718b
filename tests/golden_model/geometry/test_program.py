"""Programs: what they compute when they are executed instruction by instruction, and how they are scheduled."""

import numpy as np
import pytest

from golden_model.geometry.floating import Floats
from golden_model.geometry.program import (
    LATENCY_CYCLES,
    MAX_WAIT,
    Coordinate,
    Program,
    Source,
    constants,
    held,
    loaded,
    schedule,
)
from golden_model.geometry.programs import FIRST_FREE, PROGRAMS


def executed(program: Program, registers: dict[int, float], inputs: dict[int, int]) -> dict[int, Floats]:
    """Registers after the program; a result can be read only after its latency, before it the old number is."""
    numbers = {n: Floats.from_real(np.array([value])) for n, value in {0: 0.0, 1: 1.0, **registers}.items()}
    under_way: list[tuple[int, int, Floats]] = []
    clock = 0
    for each in program.instructions:
        for done, register, value in [entry for entry in under_way if entry[0] <= clock]:
            numbers[register] = value
            under_way.remove((done, register, value))
        if each.result:
            if each.source == Source.LOAD:
                a = Floats.from_integers(np.array([inputs[each.a]]), 16)
            else:
                a = numbers[each.a].seed() if each.source == Source.SEED else numbers[each.a]
            c, b = numbers[each.c], numbers[each.b]
            under_way.append((clock + LATENCY_CYCLES, each.result, c.minus(a, b) if each.negate else c.plus(a, b)))
        clock += 1 + each.wait
    assert program.cycles >= max(done for done, *_ in under_way)
    return {**numbers, **{register: value for _, register, value in under_way}}


def test_a_program_computes_its_formula() -> None:
    zero, one = constants()
    x = zero.plus(one, loaded(3, Coordinate.RIGHT_Y))
    root = held(9).minus(x, x)
    inverse = root.seed()
    inverse = inverse.plus(inverse, one.minus(inverse, root))
    # Old values are read before results overwrite them.
    program = schedule([(9, held(9).plus(x, one)), (10, inverse)], first=20)
    numbers = executed(program, {9: 0.75}, {3 * 8 + 3: 1 << 14})
    assert numbers[9].to_real() == 1.0
    assert numbers[10].to_real() == pytest.approx(1 / (0.75 - 0.0625), rel=2**-13)


def test_registers_are_used_again_and_never_too_early() -> None:
    zero, one = constants()
    total, expected = held(2), 0.5
    for _ in range(40):
        total = total.plus(zero.plus(held(3), one), held(3))
        expected += 0.25**2
    program = schedule([(2, total)], first=80)
    assert executed(program, {2: 0.5, 3: 0.25}, {})[2].to_real() == expected
    assert program.cycles >= 40 * LATENCY_CYCLES


def test_too_few_registers_are_refused() -> None:
    zero, one = constants()
    values = [zero.plus(one, loaded(0, Coordinate.LEFT_X)) for _ in range(5)]
    total = zero
    for value in values:
        total = total.plus(value, value)
    with pytest.raises(ValueError, match="2 registers do not suffice"):
        schedule([(2, total)], first=126)


def test_the_programs_write_to_free_registers_and_fit_the_memory() -> None:
    assert sum(len(program.instructions) for program in PROGRAMS) <= 1024
    for program in PROGRAMS:
        assert all(each.wait <= MAX_WAIT for each in program.instructions)
        assert all(2 <= each.result <= 25 or each.result >= 32 for each in program.instructions if each.result)
    assert FIRST_FREE == 64
