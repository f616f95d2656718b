"""Bursts into a memory: limits; what arrives is in the tests of rings, frames and the canvas."""

from typing import Any

import pytest

from hdl.axi.axi_write import BURST_WORDS, MAX_OUTSTANDING, BurstWriter
from tests.hdl.block_bench import BlockBench


@pytest.mark.parametrize("waits", ["awready", "wready"])
def test_neither_address_nor_words_alone_are_a_burst(waits: str) -> None:
    dut = BurstWriter()
    bench = BlockBench(dut, cycle_limit=100)

    async def run(ctx: Any) -> None:
        for port in (dut.bus.awready, dut.bus.wready, dut.i.valid):
            ctx.set(port, 1)
        ctx.set(getattr(dut.bus, waits), 0)
        await bench.pulse(ctx, dut.i_start)
        await ctx.tick().repeat(BURST_WORDS + 1)
        assert (ctx.get(dut.o_sent), ctx.get(dut.o_ready)) == (0, 0)
        ctx.set(getattr(dut.bus, waits), 1)
        await ctx.tick().repeat(BURST_WORDS)
        assert (ctx.get(dut.o_sent), ctx.get(dut.o_ready), ctx.get(dut.o_all_answered)) == (1, 1, 0)

    bench.run(run)


def test_no_burst_starts_while_too_many_have_no_answer() -> None:
    dut = BurstWriter()
    bench = BlockBench(dut, cycle_limit=1000)

    async def run(ctx: Any) -> None:
        for port in (dut.bus.awready, dut.bus.wready, dut.i.valid):
            ctx.set(port, 1)
        for _ in range(MAX_OUTSTANDING):
            assert ctx.get(dut.o_ready)
            await bench.pulse(ctx, dut.i_start)
            await ctx.tick().repeat(BURST_WORDS)
            assert ctx.get(dut.o_sent)
        assert not ctx.get(dut.o_ready)
        # It is ignored: nothing is offered.
        await bench.pulse(ctx, dut.i_start)
        assert not ctx.get(dut.bus.awvalid)
        await bench.pulse(ctx, dut.bus.bvalid)
        assert ctx.get(dut.o_ready)
        assert not ctx.get(dut.o_all_answered)
        ctx.set(dut.bus.bvalid, 1)
        await ctx.tick().repeat(MAX_OUTSTANDING - 1)
        ctx.set(dut.bus.bvalid, 0)
        assert ctx.get(dut.o_all_answered)

    bench.run(run)
