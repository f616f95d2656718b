# amaranth: UnusedElaboratable=no
"""What is read against a dictionary; the memory as it is, not the one that stands for it in tests of other blocks."""

from typing import Any

import numpy as np
import pytest
from amaranth.sim import Simulator

from hdl.lib.line_memory import LineMemory
from tests.hdl.block_bench import CLOCK_S


@pytest.mark.parametrize("loads", [False, True])
def test_a_word_comes_after_the_latency_or_its_load_and_stays_until_the_next_one(*, loads: bool) -> None:
    depth, clocks = 24, 600
    dut, rng = LineMemory(shape=9, depth=depth, loads=loads), np.random.default_rng(1)
    stored = [0] * depth
    waiting: int | None = None
    word = 0

    async def run(ctx: Any) -> None:
        nonlocal waiting, word
        for clock in range(clocks):
            read, write = rng.random(2) < (0.6, 0.5)
            read_at, write_at = rng.integers(0, depth, 2).tolist()
            # What a read of the word under way gives is not specified.
            write &= read_at != write_at
            value = int(rng.integers(0, 1 << 9))
            for port, bits in (
                (dut.i_read, int(read)),
                (dut.i_read_address, read_at),
                (dut.i_write, int(write)),
                (dut.i_write_address, write_at),
                (dut.i_word, value),
            ):
                ctx.set(port, bits)
            assert ctx.get(dut.o_word) == word, f"clock {clock}"
            load = waiting is not None and (not loads or rng.random() < 0.5)
            if loads:
                ctx.set(dut.i_load, int(load))
            if waiting is not None and load:
                word, waiting = waiting, None
            if read:
                waiting = stored[read_at]
            if write:
                stored[write_at] = value
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(CLOCK_S)
    simulator.add_testbench(run)
    simulator.run()
    assert any(stored)
