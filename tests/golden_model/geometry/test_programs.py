"""The programs, executed instruction by instruction, leave what their formulas give; and how they are scheduled."""

from collections.abc import Sequence

import numpy as np
import pytest

from golden_model.geometry.floating import Floats
from golden_model.geometry.program import LANES, SLOTS, Coordinate, constants, loaded, schedule
from golden_model.geometry.programs import (
    ADD,
    AREAS,
    AREAS_KEPT,
    CLEAR,
    FIRST_ELEMENT,
    FIRST_SUM,
    FIT,
    GROUP,
    LANE_REGISTERS,
    SOLVE,
)
from golden_model.geometry.refit import SUMS, factors, solve_sums
from golden_model.geometry.sampling import SAMPLE
from golden_model.geometry.solving import areas, solve
from tests.golden_model.geometry.execution import executed, number


def test_too_few_registers_are_refused() -> None:
    zero, one = constants()
    values = [zero.plus(one, loaded(0, Coordinate.LEFT_X)) for _ in range(5)]
    total = zero
    for value in values:
        total = total.plus(value, value)
    with pytest.raises(ValueError, match="2 registers are not enough"):
        schedule([(2, total)], first=126)


CENTRE = [Floats.from_integers(np.array([side * 8]), 16) for side in (640, 480)]
BITS = {Coordinate.WEIGHT: 8}
NOUGHT, ONE = number(0), number(1)


def random_match(rng: np.random.Generator) -> list[Floats]:
    """Left x and y, right x and y, weight."""
    left = rng.integers(0, [640 * 16, 480 * 16])
    right = left * 9 // 10 + rng.integers(200, 400, 2)
    values = *left, *right, rng.integers(1, 256)
    return [Floats.from_integers(np.array([each]), BITS.get(Coordinate(n), 16)) for n, each in enumerate(values)]


def in_slots(matches: Sequence[Sequence[Floats]]) -> dict[int, Floats]:
    return {
        SLOTS * slot + coordinate: each
        for slot, match in enumerate(matches)
        for coordinate, each in enumerate([*match, *CENTRE])
    }


def bits(numbers: Sequence[Floats]) -> list[tuple[int, int, bool]]:
    return [(int(each.mantissa[0]), int(each.exponent[0]), bool(each.negative[0])) for each in numbers]


def elements(registers: dict[int, Floats], lane: int) -> list[Floats]:
    first = FIRST_ELEMENT + LANE_REGISTERS * lane
    return [registers[first + n] for n in range(9)]


def test_each_lane_solves_its_sample() -> None:
    rng = np.random.default_rng(1)
    matches = [random_match(rng) for _ in range(SAMPLE * LANES)]
    loads = in_slots(matches)
    registers = executed(SOLVE, executed(AREAS, {}, loads), loads)
    for lane in range(LANES):
        sample = matches[SAMPLE * lane : SAMPLE * (lane + 1)]
        both = [match[:2] for match in sample], [match[2:4] for match in sample]
        (left_areas, right_areas), products = areas(NOUGHT, ONE, both)
        first = FIRST_SUM + AREAS_KEPT * lane
        kept = [registers[first + n] for n in range(AREAS_KEPT)]
        assert bits(kept) == bits([*left_areas[:3], *right_areas])
        rows = solve(NOUGHT, ONE, both, (left_areas, right_areas))
        assert bits(elements(registers, lane)) == bits([each for row in rows for each in row])
        assert sum(bool(each.checks >> lane & 1) for each in AREAS.instructions) == len(products)


def test_the_fit_is_that_of_all_matches_that_were_added() -> None:
    rng = np.random.default_rng(2)
    matches = [random_match(rng) for _ in range(2 * GROUP)]
    registers = executed(CLEAR, {FIRST_SUM + n: number(n + 5) for n in range(SUMS)}, {})
    sums = [NOUGHT] * SUMS
    centre = [NOUGHT.plus(ONE, each) for each in CENTRE]
    for group in (matches[:GROUP], matches[GROUP:]):
        registers = executed(ADD, registers, in_slots(group))
        for match in group:
            pairs = factors(NOUGHT, ONE, centre, match[:4], match[4])
            sums = [total.plus(*pair) for total, pair in zip(sums, pairs, strict=True)]
    assert bits([registers[FIRST_SUM + n] for n in range(SUMS)]) == bits(sums)
    rows, determinant = solve_sums(NOUGHT, ONE, centre, sums)
    registers = executed(FIT, registers, in_slots(matches[:1]))
    assert bits(elements(registers, 0)) == bits([each for row in rows for each in row])
    (checked,) = (each.result for each in FIT.instructions if each.checks)
    assert bits([registers[checked]]) == bits([determinant])
