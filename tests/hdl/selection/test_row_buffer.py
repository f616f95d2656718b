"""A closed row leaves in the order of its cells and places, while the next one is written."""

from typing import Any

import numpy as np
import pytest

from golden_model.feature.ilbp import PATTERNS
from hdl.selection.row_buffer import CellRows
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench

PATTERN = PATTERNS["thesis-ilbp-1"]
CELLS = 4
"""A power of two: at the end of a row, the number of the next cell is again that of one with features."""
ROWS = 4


def random_row(rng: np.random.Generator, first: int) -> list[dict[int, int]]:
    """For each cell, which slot holds which feature, by place; some cells are empty."""
    numbers = iter(range(first, first + 8 * CELLS))
    counts = rng.integers(0, 9, CELLS) * (rng.random(CELLS) < 0.7)
    return [{slot: next(numbers) for slot in rng.permutation(8)[:count].tolist()} for count in counts]


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(stalls=200, seed=3)], ids=["free", "stalls"])
def test_rows_leave_in_order_while_the_next_one_is_written(pauses: Pauses) -> None:
    dut = CellRows(pattern=PATTERN, cells=CELLS)
    bench = BlockBench(dut, pauses=pauses)
    rng = np.random.default_rng(2)
    rows = [random_row(rng, 1 + 100 * number) for number in range(ROWS)]
    received: list[Any] = []

    async def write(ctx: Any) -> None:
        for number, row in enumerate(rows):
            for cell, slots in enumerate(row):
                order = [{"taken": 1, "slot": slot} for slot in slots]
                for slot, feature in slots.items():
                    ctx.set(dut.i_write, 1)
                    ctx.set(dut.i_cell, cell)
                    ctx.set(dut.i_slot, slot)
                    ctx.set(dut.i_feature, {"x": feature})
                    ctx.set(dut.i_order, [*order, *[{"taken": 0, "slot": 0}] * (8 - len(order))])
                    await ctx.tick()
            ctx.set(dut.i_write, 0)
            while number and not drained[0]:
                await ctx.tick()
            drained[0] = False
            ctx.set(dut.i_touched, sum(1 << cell for cell, slots in enumerate(row) if slots))
            ctx.set(dut.i_ends_level, number == ROWS - 1)
            await bench.pulse(ctx, dut.i_close)

    drained = [False]

    async def watch(ctx: Any) -> None:
        async for *_, ends in ctx.tick().sample(dut.o_drained):
            drained[0] |= bool(ends)

    async def take(ctx: Any) -> None:
        while len(received) < sum(len(slots) for row in rows for slots in row) + ROWS:
            item = await bench.stream_get(ctx, dut.o)
            received.append(("end", item.ends_level) if item.ends_row else item.feature.x)

    bench.run(write, take, background=[watch])
    expected: list[Any] = []
    for number, row in enumerate(rows):
        expected += [feature for slots in row for feature in slots.values()]
        expected.append(("end", int(number == ROWS - 1)))
    assert received == expected


def test_the_first_feature_leaves_after_the_latency_and_a_clock_for_each_empty_cell() -> None:
    for empty in range(3):
        dut = CellRows(pattern=PATTERN, cells=CELLS)
        cycles: list[int] = []

        async def run(ctx: Any, dut: CellRows = dut, cell: int = empty, cycles: list[int] = cycles) -> None:
            ctx.set(dut.i_write, 1)
            ctx.set(dut.i_cell, cell)
            ctx.set(dut.i_order, [{"taken": 1, "slot": 0}, *[{"taken": 0, "slot": 0}] * 7])
            ctx.set(dut.i_touched, 1 << cell)
            ctx.set(dut.i_close, 1)
            await ctx.tick()
            ctx.set(dut.i_write, 0)
            ctx.set(dut.i_close, 0)
            cycles.append(1)
            while not ctx.get(dut.o.valid):
                await ctx.tick()
                cycles[0] += 1

        BlockBench(dut, cycle_limit=30).run(run)
        assert cycles == [dut.latency_cycles + empty]
