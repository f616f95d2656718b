"""Bursts from a memory that delays, refuses and checks AXI's rules."""

import random
from typing import Any

import numpy as np

from golden_model.records import WORD_BYTES
from hdl.axi.axi_read import MAX_OPEN_BURSTS, BurstReader
from hdl.axi.axi_write import BURST_BYTES, BURST_WORDS
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.shell.axi_memory import AxiMemory

BASE, BURSTS = 0x12_3456_F800, 32
"""Across a border of 4 KiB."""


def test_words_come_in_the_order_of_the_bursts() -> None:
    memory = AxiMemory(BASE, BURSTS * BURST_BYTES, waits=60, errors=80, seed=2)
    dut, rng = BurstReader(), random.Random(3)
    memory.bytes[:] = np.random.default_rng(4).integers(0, 256, memory.bytes.size)
    bench = BlockBench(dut, pauses=Pauses(stalls=60, seed=5), cycle_limit=6000)
    ends = [sorted(rng.choices(range(BURST_WORDS), k=2)) for _ in range(20)]
    # The shortest and the longest, and one behind the other in the same place.
    parts = [(rng.randrange(BURSTS), *each) for each in [[0, 15], [0, 0], [15, 15], *ends]] * 2
    words = memory.bytes.view("<u8").reshape(BURSTS, BURST_WORDS)
    expected = [int(word) for burst, first, last in parts for word in words[burst, first : last + 1]]
    received: list[tuple[int, int]] = []
    errors = 0

    async def watch(ctx: Any) -> None:
        nonlocal errors
        async for *_, error in ctx.tick().sample(dut.o_error):
            errors += error

    async def send(ctx: Any) -> None:
        for burst, first, last in parts:
            await bench.stream_put(ctx, dut.i, {"burst": BASE // BURST_BYTES + burst, "first": first, "last": last})

    async def receive(ctx: Any) -> None:
        for _ in expected:
            word = await bench.stream_get(ctx, dut.o)
            received.append((word.data, word.failed))
            assert not ctx.get(dut.o_all_answered) or len(received) == len(expected)
        assert ctx.get(dut.o_all_answered)

    bench.run(send, receive, background=[memory.read_port(dut.bus), watch])
    assert [word for word, failed in received if not failed] == [
        word for word, (_, failed) in zip(expected, received, strict=True) if not failed
    ]
    assert errors == sum(failed for _, failed in received)
    assert memory.error_count > 0


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
