# amaranth: UnusedElaboratable=no
"""The processor leaves what the golden model computes, after the clocks that the programs take."""

from typing import Any

import numpy as np

from golden_model.geometry import estimator
from golden_model.geometry.floating import Floats
from golden_model.geometry.program import LANES, LATENCY_CYCLES
from golden_model.geometry.programs import (
    ADD,
    AREAS,
    CLEAR,
    ELEMENTS,
    FIRST_ELEMENT,
    FIT,
    GROUP,
    LANE_REGISTERS,
    PROGRAMS,
    SOLVE,
)
from golden_model.geometry.refit import factors, solve_sums
from golden_model.geometry.solving import areas, solve
from hdl.geometry.match_gain import PAIR
from hdl.geometry.processor import INSTRUCTION, Processor
from tests.hdl.block_bench import BlockBench

SIZE = (640, 480)


def matches(count: int, seed: int) -> np.ndarray:
    """Left x, y, right x, y, weight; the last two samples turn a triangle over, or lie on a line."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, [16 * side for side in SIZE], (count, 2))
    right = np.abs(left * 9 // 10 + rng.integers(-50, 50, left.shape) + 300)
    right[4] = right[5]
    return np.hstack((left, right, rng.integers(1, 256, (count, 1))))


async def run_program(ctx: Any, dut: Processor, program: Any, given: np.ndarray) -> int:
    """Run with the matches in the slots; return the clocks that it was busy."""
    ctx.set(dut.i_program, PROGRAMS.index(program))
    ctx.set(dut.i_start, 1)
    await ctx.tick()
    ctx.set(dut.i_start, 0)
    cycles = 0
    slots = [0, 0, 0]
    while ctx.get(dut.o_busy):
        slots = [*slots[1:], ctx.get(dut.o_slot)]
        await ctx.tick()
        row = given[slots[1]] if slots[1] < len(given) else np.zeros(5, int)
        ctx.set(dut.i_match, {"pair": dict(zip(PAIR.members, row.tolist(), strict=False)), "weight": int(row[4])})
        cycles += 1
    return cycles


async def elements(ctx: Any, dut: Processor, lane: int) -> list[tuple[int, int]]:
    read = []
    for n in range(ELEMENTS + 2):
        ctx.set(dut.i_register, FIRST_ELEMENT + LANE_REGISTERS * lane + min(n, ELEMENTS - 1))
        await ctx.tick()
        each = dut.o_register
        if n >= 1:
            read.append((ctx.get(each.mantissa) * (-1) ** ctx.get(each.negative), ctx.get(each.exponent)))
    return read[:ELEMENTS]


def as_pairs(rows: list[list[Floats]], sample: int = 0) -> list[tuple[int, int]]:
    each = Floats.stack([value for row in rows for value in row])[sample]
    return list(
        zip(np.where(each.negative, -each.mantissa, each.mantissa).tolist(), each.exponent.tolist(), strict=True)
    )


def test_programs_leave_what_the_golden_model_computes() -> None:
    given = matches(8, seed=3)
    results: list[Any] = []
    dut = Processor()

    async def run(ctx: Any) -> None:
        for n, side in enumerate(SIZE):
            ctx.set(dut.i_centre[n], side * 8)
        await ctx.tick().repeat(2)
        cycles = [await run_program(ctx, dut, AREAS, given)]
        results.append(ctx.get(dut.o_passed))
        cycles.append(await run_program(ctx, dut, SOLVE, given))
        results.append([await elements(ctx, dut, lane) for lane in range(LANES)])
        results.append([ctx.get(each) for each in dut.o_exponents])
        cycles.append(await run_program(ctx, dut, CLEAR, given))
        for group in range(2):
            cycles.append(await run_program(ctx, dut, ADD, given[GROUP * group :][:GROUP]))
        cycles.append(await run_program(ctx, dut, FIT, given))
        results.append(await elements(ctx, dut, 0))
        results.append((ctx.get(dut.o_passed) & 1, cycles))

    BlockBench(dut, cycle_limit=3000, settings={}).run(run)
    zero, one = (Floats.from_real(np.full(1, float(value))) for value in (0, 1))
    left, right = (
        [[Floats.from_integers(given[k::4, c], 16) for c in pair] for k in range(4)] for pair in ((0, 1), (2, 3))
    )
    kept, products = areas(zero, one, (left, right))
    valid = np.all([estimator.passes(each) for each in products], axis=0)
    assert (results.pop(0), valid.tolist()) == (1, [True, False])
    rows = solve(zero, one, (left, right), kept)
    assert results[0] == [as_pairs(rows, lane) for lane in range(LANES)]
    exponents = np.max([np.broadcast_to(each.exponent, 2) for row in rows for each in row], axis=0)
    assert results[1] == exponents.tolist()
    sums = Floats.from_real(np.zeros(23))
    centre = [zero.plus(one, Floats.from_integers(np.array([side * 8]), 16)) for side in SIZE]
    for row in given:
        numbers = [Floats.from_integers(row[c : c + 1], 16) for c in range(4)]
        pairs = factors(zero, one, centre, numbers, Floats.from_integers(row[4:], 8))
        first, second = (Floats.stack([pair[n] for pair in pairs])[0] for n in range(2))
        sums = sums.plus(first, second)
    rows, determinant = solve_sums(zero, one, centre, [sums[n : n + 1] for n in range(23)])
    assert results[2] == as_pairs(rows)
    passed, cycles = results[3]
    assert passed == estimator.passes(determinant)[0]
    assert cycles == [each.cycles + dut.start_cycles - 1 for each in (AREAS, SOLVE, CLEAR, ADD, ADD, FIT)]


def test_the_programs_fill_block_rams_of_36_bits() -> None:
    """As many words as the documentation says: one bit more, and a block RAM holds half as many."""
    assert (sum(len(each.instructions) for each in PROGRAMS), INSTRUCTION.size) == (621, 36)


def test_the_schedule_uses_no_result_too_early() -> None:
    """Executed in its order of issue, no instruction of a program reads a register while a write to it is under way."""
    for program in PROGRAMS:
        written: dict[int, int] = {}
        clock = 0
        for each in program.instructions:
            read = {each.b, each.c} | ({each.a} if each.source != 2 else set())
            assert all(written.get(register, -LATENCY_CYCLES) + LATENCY_CYCLES <= clock for register in read - {0, 1})
            if each.result:
                written[each.result] = clock
            clock += 1 + each.wait
        assert program.cycles >= clock
