"""Packets pass or go as they began, and what a clear breaks off ends in order; `tests/formal` proves the rules."""

import random
from typing import Any

import numpy as np
import pytest

from golden_model.records import FRAME_STATUS, WORD_BYTES, Cause, Tag
from hdl.axi.packet_gate import CLOSING_RECORDS, PacketGate
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench

RECORD_WORDS = 5
"""More than a FrameStatus has."""
STATUS = FRAME_STATUS.dtype_padded_to(RECORD_WORDS * WORD_BYTES)


def packet(records: int, number: int) -> list[int]:
    """Words of records, then of a status that tells the number."""
    status = np.zeros((), STATUS)
    status["tag"], status["good"], status["frame"], status["features"] = Tag.FRAME_STATUS, 1, number, records
    words = [Tag.FEATURE | number << 32 | n << 8 for n in range(records * RECORD_WORDS)]
    return words + np.frombuffer(status.tobytes(), np.uint64).tolist()


async def send(ctx: Any, bench: BlockBench, words: list[int]) -> None:
    for n, word in enumerate(words):
        await bench.stream_put(ctx, bench.dut.i, {"data": word, "last": n == len(words) - 1})


async def take(ctx: Any, bench: BlockBench, packets: list[list[int]]) -> None:
    packets.append([])
    while True:
        word = await bench.stream_get(ctx, bench.dut.o)
        packets[-1].append(word.data)
        if word.last:
            packets.append([])


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=90, stalls=130, seed=1)], ids=["free", "pauses"])
def test_packets_pass_or_go_whole_and_their_status_is_told(pauses: Pauses) -> None:
    dut = PacketGate(record_bytes=RECORD_WORDS * WORD_BYTES)
    bench, rng = BlockBench(dut, pauses=pauses, cycle_limit=4000), random.Random(1)
    sent = [packet(rng.randrange(4), number) for number in range(12)]
    passes = [rng.random() < 0.5 for _ in sent]
    received: list[list[int]] = []
    told: list[tuple[int, int]] = []

    async def run(ctx: Any) -> None:
        for number, (words, enable) in enumerate(zip(sent, passes, strict=True)):
            ctx.set(dut.i_enable, enable)
            # Within the packet the switch changes nothing.
            await bench.stream_put(ctx, dut.i, {"data": words[0], "last": 0})
            await ctx.tick().repeat(2)
            ctx.set(dut.i_enable, rng.randrange(2))
            for n, word in enumerate(words[1:], 2):
                await bench.stream_put(ctx, dut.i, {"data": word, "last": n == len(words)})
            while len(told) <= number:
                await ctx.tick()

    async def watch(ctx: Any) -> None:
        async for *_, done, status in ctx.tick().sample(dut.o_done, dut.o_status):
            if done:
                told.append((status.frame, status.features))

    async def sink(ctx: Any) -> None:
        await take(ctx, bench, received)

    bench.run(run, background=[watch, sink])
    assert received[:-1] == [words for words, enable in zip(sent, passes, strict=True) if enable]
    assert told == [(n, (len(words) - RECORD_WORDS) // RECORD_WORDS) for n, words in enumerate(sent)]


@pytest.mark.parametrize("passes", [True, False])
@pytest.mark.parametrize("taken", [0, 1, 3, RECORD_WORDS, 2 * RECORD_WORDS + 2])
def test_a_clear_closes_the_packet_under_way_and_the_next_one_is_whole(taken: int, passes: bool) -> None:
    dut = PacketGate(record_bytes=RECORD_WORDS * WORD_BYTES)
    bench = BlockBench(dut, cycle_limit=400)
    broken, whole = packet(3, 1), packet(1, 2)
    received: list[list[int]] = []
    done: list[int] = []

    async def run(ctx: Any) -> None:
        ctx.set(dut.i_enable, passes)
        for word in broken[:taken]:
            await bench.stream_put(ctx, dut.i, {"data": word, "last": 0})
        await bench.pulse(ctx, dut.i_clear)
        ctx.set(dut.i_enable, 1)
        while ctx.get(dut.o_closing):
            await ctx.tick()
        await send(ctx, bench, whole)
        await ctx.tick().repeat(20)

    async def watch(ctx: Any) -> None:
        async for *_, ends, status in ctx.tick().sample(dut.o_done, dut.o_status):
            if ends:
                done.append(status.frame)

    async def sink(ctx: Any) -> None:
        await take(ctx, bench, received)

    bench.run(run, background=[watch, sink])
    *closed, last, rest = received
    assert (last, rest) == (whole, [])
    # A packet that is broken off belongs to no frame.
    assert done == [2]
    if closed:
        (words,) = closed
        kept = next((n for n, word in enumerate(words) if word not in broken[: n + 1]), len(words))
        assert words[:kept] == broken[:kept]
        assert len(words) % RECORD_WORDS == 0
        assert len(words) <= taken + CLOSING_RECORDS * RECORD_WORDS
        (status,) = np.array(words[-RECORD_WORDS:], np.uint64).view(STATUS)
        assert (int(status["tag"]), int(status["good"]), int(status["causes"])) == (Tag.FRAME_STATUS, 0, Cause.CLEARED)
        assert not any(words[kept:-RECORD_WORDS])
    else:
        assert taken <= 1 or not passes


def test_a_packet_that_ends_in_the_clock_of_a_clear_is_whole_and_not_told() -> None:
    dut = PacketGate(record_bytes=RECORD_WORDS * WORD_BYTES)
    bench = BlockBench(dut, settings={"i_enable": 1}, cycle_limit=100)
    received: list[list[int]] = []
    done: list[int] = []
    both = [0]

    async def run(ctx: Any) -> None:
        await send(ctx, bench, packet(1, 1))
        await bench.pulse(ctx, dut.i_clear)
        await send(ctx, bench, packet(1, 2))
        await ctx.tick().repeat(5)

    async def watch(ctx: Any) -> None:
        leaves = dut.o.valid & dut.o.ready & dut.o.payload.last
        async for *_, meets, ends, status in ctx.tick().sample(dut.i_clear & leaves, dut.o_done, dut.o_status):
            both[0] += meets
            if ends:
                done.append(status.frame)

    async def sink(ctx: Any) -> None:
        await take(ctx, bench, received)

    bench.run(run, background=[watch, sink])
    assert both == [1]
    assert received == [packet(1, 1), packet(1, 2), []]
    assert done == [2]
