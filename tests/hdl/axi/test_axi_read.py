"""Bursts from a memory: limits and addresses; what comes is in the tests of windows and of the canvas."""

from typing import Any

from golden_model.records import WORD_BYTES
from hdl.axi.axi_read import MAX_OPEN_BURSTS, BurstReader
from hdl.axi.axi_write import BURST_BYTES
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


def test_an_address_is_that_of_the_first_word() -> None:
    dut = BurstReader()
    bench = BlockBench(dut, cycle_limit=100)

    async def run(ctx: Any) -> None:
        await bench.stream_put(ctx, dut.i, {"burst": (1 << 57) - 1, "first": 3, "last": 14})
        assert ctx.get(dut.bus.araddr) == (1 << 64) - BURST_BYTES + 3 * WORD_BYTES
        assert ctx.get(dut.bus.arlen) == 11

    bench.run(run)
