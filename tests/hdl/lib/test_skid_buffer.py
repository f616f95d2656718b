# amaranth: UnusedElaboratable=no
"""No signal of one side depends on the other in the same clock."""

from typing import Any

from hdl.lib.skid_buffer import SkidBuffer
from tests.hdl.block_bench import BlockBench


def test_no_path_leads_from_one_side_to_the_other() -> None:
    dut = SkidBuffer(shape=8)

    async def run(ctx: Any) -> None:
        ctx.set(dut.i.payload, 1)
        for valid, ready in ((0, 0), (1, 0), (1, 0), (1, 1), (0, 1), (1, 1)):
            before = ctx.get(dut.i.ready), ctx.get(dut.o.valid), ctx.get(dut.o.payload)
            for each in (0, 1):
                ctx.set(dut.i.valid, each)
                ctx.set(dut.o.ready, each)
                ctx.set(dut.i.payload, 2 + each)
                assert (ctx.get(dut.i.ready), ctx.get(dut.o.valid), ctx.get(dut.o.payload)) == before
            ctx.set(dut.i.valid, valid)
            ctx.set(dut.o.ready, ready)
            await ctx.tick()

    BlockBench(dut).run(run)
