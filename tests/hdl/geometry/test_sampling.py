# amaranth: UnusedElaboratable=no
"""The ranks drawn equal the golden model's, for few and many matches, in every step."""

from typing import Any

import pytest

from golden_model.geometry.estimator import MAX_MATCHES
from golden_model.geometry.sampling import STEPS, draw, subset_size
from hdl.geometry.sampling import DRAWS, SampleDraws
from tests.hdl.block_bench import BlockBench

SEED = 0x1234_5678


@pytest.mark.parametrize("count", [5, MAX_MATCHES])
def test_ranks_equal_the_golden_model(count: int) -> None:
    dut = SampleDraws()
    ranks: list[list[int]] = []

    async def run(ctx: Any) -> None:
        await bench.pulse(ctx, dut.i_restart)
        for step in range(STEPS):
            ctx.set(dut.i_step, step)
            await bench.pulse(ctx, dut.i_start)
            for _ in range(dut.latency_cycles - 1):
                assert not ctx.get(dut.o_valid)
                await ctx.tick()
            drawn = []
            for _ in range(DRAWS):
                assert ctx.get(dut.o_valid)
                drawn.append(ctx.get(dut.o_rank))
                await ctx.tick()
            assert not ctx.get(dut.o_valid)
            ranks.append(drawn)

    bench = BlockBench(dut, settings={"i_seed": SEED, "i_count": count}, cycle_limit=2000)
    bench.run(run)
    state, wanted = SEED, []
    for step in range(STEPS):
        first, state = draw(state, subset_size(count, step))
        second, state = draw(state, subset_size(count, step))
        wanted.append(first + second)
        assert len(set(first)) == len(set(second)) == 4
    assert ranks == wanted
