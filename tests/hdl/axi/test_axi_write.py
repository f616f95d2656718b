"""Bursts into a memory that delays, refuses and checks AXI's rules."""

import random
from typing import Any

import numpy as np
import pytest

from golden_model.records import WORD_BYTES
from hdl.axi.axi_write import BURST_BYTES, BURST_WORDS, MAX_OUTSTANDING, BurstWriter
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.shell.axi_memory import AxiMemory

BASE, LENGTH_BYTES = 0x12_3456_0000, 16 * BURST_BYTES


@pytest.mark.parametrize(
    "rules",
    [{}, {"waits": 120, "latency_clocks": 40, "seed": 1}, {"data_first": True, "waits": 60, "errors": 80, "seed": 2}],
    ids=["fast", "slow", "errors"],
)
def test_bursts_arrive_where_they_belong(rules: dict[str, Any]) -> None:
    memory, dut, rng = AxiMemory(BASE, LENGTH_BYTES, **rules), BurstWriter(), random.Random(3)
    # In the gaps between words nothing is offered.
    bench = BlockBench(dut, pauses=Pauses(gaps=60, seed=4), cycle_limit=4000)
    expected = np.zeros(LENGTH_BYTES, np.uint8)
    errors = [0]

    async def watch(ctx: Any) -> None:
        async for *_, error in ctx.tick().sample(dut.o_error):
            errors[0] += error

    async def run(ctx: Any) -> None:
        for number in rng.sample(range(16), 12):
            while not ctx.get(dut.o_ready):
                await ctx.tick()
            ctx.set(dut.i_burst, BASE // BURST_BYTES + number)
            await bench.pulse(ctx, dut.i_start)
            for word in range(BURST_WORDS):
                value, kept = rng.getrandbits(64), rng.random() < 0.8
                if kept:
                    at = number * BURST_BYTES + word * WORD_BYTES
                    expected[at : at + WORD_BYTES] = np.frombuffer(value.to_bytes(WORD_BYTES, "little"), np.uint8)
                await bench.stream_put(ctx, dut.i, {"data": value, "kept": kept})
        while not ctx.get(dut.o_all_answered):
            assert not (ctx.get(dut.o_sent) and ctx.get(dut.bus.awvalid))
            await ctx.tick()

    bench.run(run, background=[memory.port(dut.bus), watch])
    assert errors[0] == memory.error_count
    assert (memory.error_count > 0) == ("errors" in rules)
    is_written = (memory.bytes.reshape(16, -1) == expected.reshape(16, -1)).all(axis=1)
    assert np.count_nonzero(~is_written) == memory.error_count


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
