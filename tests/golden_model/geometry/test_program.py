"""Programs: what they compute when they are executed instruction by instruction, and how they are scheduled."""

import numpy as np
import pytest

from golden_model.geometry.floating import Floats
from golden_model.geometry.program import (
    LATENCY_CYCLES,
    ZERO,
    Coordinate,
    constants,
    held,
    loaded,
    schedule,
)
from tests.golden_model.geometry.execution import executed, number, to_real


def test_a_program_computes_its_formula() -> None:
    zero, one = constants()
    x = zero.plus(one, loaded(3, Coordinate.RIGHT_Y))
    root = held(9).minus(x, x)
    inverse = root.seed()
    inverse = inverse.plus(inverse, one.minus(inverse, root))
    # Old values are read before results overwrite them.
    program = schedule([(9, held(9).plus(x, one)), (10, inverse)], first=20)
    numbers = executed(program, {9: number(0.75)}, {3 * 8 + 3: Floats.from_integers(np.array([1 << 14]), 16)})
    assert to_real(numbers[9]) == 1.0
    assert to_real(numbers[10]) == pytest.approx(1 / (0.75 - 0.0625), rel=2**-13)


def test_registers_are_used_again_and_never_too_early() -> None:
    zero, one = constants()
    total, expected = held(2), 0.5
    for _ in range(40):
        total = total.plus(zero.plus(held(3), one), held(3))
        expected += 0.25**2
    program = schedule([(2, total)], first=80)
    assert to_real(executed(program, {2: number(0.5), 3: number(0.25)}, {})[2]) == expected
    assert program.cycles >= 40 * LATENCY_CYCLES
    # The others belong to those who run it.
    assert min({each.result for each in program.instructions} - {2, ZERO}) == 80


def test_too_few_registers_are_refused() -> None:
    zero, one = constants()
    values = [zero.plus(one, loaded(0, Coordinate.LEFT_X)) for _ in range(5)]
    total = zero
    for value in values:
        total = total.plus(value, value)
    with pytest.raises(ValueError, match="2 registers are not enough"):
        schedule([(2, total)], first=126)
