"""A reset, and how many bursts may be open.

`tests/formal` proves the rules of `axi_lite`, `axi_read`, `axi_write` and `packet_gate`; the words of bursts are rows
of the catalogue; `tests/cocotb` uses the buses of `flat_ports`.
"""

from typing import Any

import pytest

from hdl.axi.axi_lite import AxiLiteSubordinate, Response
from hdl.axi.axi_read import MAX_OPEN_BURSTS, BurstReader
from hdl.axi.axi_write import BURST_WORDS, MAX_OUTSTANDING, BurstWriter
from tests.hdl.block_bench import BlockBench


def test_nothing_is_accepted_during_reset() -> None:
    """It would never get an answer."""
    dut = AxiLiteSubordinate()
    bench, bus = BlockBench(dut), dut.bus

    async def run(ctx: Any) -> None:
        await ctx.tick().repeat(3)
        for reset, clocks in ((0, 1), (1, 3), (0, 1)):
            ctx.set(bench.reset, reset)
            for _ in range(clocks):
                await ctx.tick()
                assert {ctx.get(each) for each in (bus.awready, bus.wready, bus.arready)} == {1 - reset}

    bench.run(run)


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
