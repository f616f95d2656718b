"""What several tests do with blocks that take windows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.hdl.block_bench import BlockBench


def payloads(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> list[dict[str, list[int]]]:
    return [{"left": a, "right": b} for a, b in zip(left.tolist(), right.tolist(), strict=True)]


def check_latency(dut: Any) -> None:
    """A result takes exactly the latency, and the next one as long after it was taken."""

    async def run(ctx: Any) -> None:
        ctx.set(dut.i.valid, 1)
        for _ in range(2):
            ctx.set(dut.o.ready, 0)
            await ctx.tick().repeat(dut.latency_cycles - 1)
            assert not ctx.get(dut.o.valid)
            await ctx.tick()
            assert ctx.get(dut.o.valid)
            ctx.set(dut.o.ready, 1)
            await ctx.tick().until(dut.i.ready)

    BlockBench(dut, cycle_limit=4 * dut.latency_cycles).run(run)
