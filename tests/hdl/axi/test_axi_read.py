"""How many bursts may be open, and what is an error; their words are a row of the catalogue, as is `packet_gate`."""

from typing import Any

from hdl.axi.axi_lite import Response
from hdl.axi.axi_read import MAX_OPEN_BURSTS, BurstReader
from tests.hdl.block_bench import BlockBench


def test_no_burst_is_asked_for_while_too_many_are_open() -> None:
    dut = BurstReader()
    bench = BlockBench(dut, cycle_limit=1000)

    async def run(ctx: Any) -> None:
        for port in (dut.bus.arready, dut.i.valid, dut.o.ready):
            ctx.set(port, 1)
        await ctx.tick().repeat(MAX_OPEN_BURSTS)
        assert not ctx.get(dut.i.ready)
        await ctx.tick().repeat(3)
        assert not ctx.get(dut.bus.arvalid)
        ctx.set(dut.bus.rlast, 1)
        ctx.set(dut.bus.rresp, Response.SLVERR)
        # A word with an error counts once, when it is taken.
        for valid, ready in ((0, 1), (1, 0), (1, 1)):
            ctx.set(dut.bus.rvalid, valid)
            ctx.set(dut.o.ready, ready)
            assert ctx.get(dut.o_error) == (valid & ready)
        await bench.pulse(ctx, dut.bus.rvalid)
        assert ctx.get(dut.i.ready)
        ctx.set(dut.i.valid, 0)
        ctx.set(dut.bus.rvalid, 1)
        await ctx.tick().repeat(MAX_OPEN_BURSTS - 2)
        assert not ctx.get(dut.o_all_answered)
        await ctx.tick()
        assert ctx.get(dut.o_all_answered)
        # What nobody has asked for is not taken.
        assert not ctx.get(dut.bus.rready)
        assert not ctx.get(dut.o.valid)

    bench.run(run)
