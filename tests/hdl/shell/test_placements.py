"""Records and a host's poses become the placements that the golden model makes of them, in order; nothing waits."""

from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Records
from golden_model.painting.pose import Placement, placement_of
from golden_model.records import HOMOGRAPHY, WORD_BYTES, Tag
from hdl.shell.placements import MAX_WAITING, Placements
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench

RECORD_WORDS = HOMOGRAPHY.record_bytes // WORD_BYTES
HOST_EVERY = 5


def records(count: int, seed: int = 1) -> Records:
    """Random records, every third one with causes; numbers of frames beyond 16 bits, which wrap."""
    bits = np.random.default_rng(seed).integers(0, 256, count * HOMOGRAPHY.record_bytes, dtype=np.uint8)
    found: Records = bits.view(HOMOGRAPHY.dtype)
    found["tag"], found["frame"] = Tag.HOMOGRAPHY, np.arange(count) + 0x1_FFFE
    found["causes"] = np.where(np.arange(count) % 3 == 2, found["causes"] | 1, 0)
    return found


def host_pose(frame: int) -> dict[str, Any]:
    elements = np.random.default_rng(frame).integers(-(1 << 31), 1 << 31, 9)
    return {"elements": elements.tolist(), "frame": frame}


def expected(each: np.void | dict[str, Any]) -> dict[str, Any]:
    """What leaves for a record, or a host's pose; the painter counts frames from 1."""
    if isinstance(each, dict):
        number = (each["frame"] + 1) & 0xFFFF
        return {"elements": each["elements"], "frame": number, "reference": number, "composed": 0}
    placement = placement_of(each)
    assert placement is not None
    return told(placement)


def told(placement: Placement) -> dict[str, Any]:
    numbers = {name: (getattr(placement, name) + 1) & 0xFFFF for name in ("frame", "reference")}
    return {"elements": placement.elements.ravel().tolist(), **numbers, "composed": int(placement.composed)}


class PlacementsBench:
    """Sends records and takes placements."""

    def __init__(self, *, pauses: Pauses, **settings: int) -> None:
        self.dut = Placements()
        self.bench = BlockBench(self.dut, settings={"i_enable": 1, **settings}, pauses=pauses)
        self.received: list[dict[str, Any]] = []
        self.counts = {"o_lost": 0, "o_ignored": 0}
        self.nowhere: list[int] = []

    async def send(self, ctx: Any, record: np.void, *, words: int = RECORD_WORDS) -> None:
        for n, word in enumerate(np.frombuffer(record.tobytes(), np.uint64).tolist()[:words]):
            assert ctx.get(self.dut.i.ready)
            await self.bench.stream_put(ctx, self.dut.i, {"data": word, "last": n == RECORD_WORDS - 1})

    async def set(self, ctx: Any, pose: dict[str, Any]) -> None:
        ctx.set(self.dut.i_pose, pose)
        await self.bench.pulse(ctx, self.dut.i_set)
        # What is written next does not reach the pose that waits.
        ctx.set(self.dut.i_pose, host_pose(99))

    async def receive(self, ctx: Any) -> None:
        while True:
            taken = await self.bench.stream_get(ctx, self.dut.o)
            elements = [taken.elements[n] for n in range(9)]
            self.received.append({"elements": elements, **{n: taken[n] for n in ("frame", "reference", "composed")}})

    async def count(self, ctx: Any) -> None:
        ports = self.dut.o_lost, self.dut.o_ignored, self.dut.o_nowhere.valid, self.dut.o_nowhere.frame
        async for *_, lost, ignored, is_nowhere, frame in ctx.tick().sample(*ports):
            self.counts["o_lost"] += lost
            self.counts["o_ignored"] += ignored
            self.nowhere += [frame] * is_nowhere

    def run(self, *testbenches: Any, takes: bool = True) -> None:
        self.bench.run(*testbenches, background=[self.count, *([self.receive] if takes else [])])


@pytest.mark.parametrize("pauses", [Pauses(), Pauses(gaps=150, stalls=200, seed=4)], ids=["back to back", "pauses"])
def test_records_and_poses_become_placements(pauses: Pauses) -> None:
    bench = PlacementsBench(pauses=pauses)
    sent: list[Any] = []
    nowhere: list[np.void] = []

    async def feed(ctx: Any) -> None:
        for n, record in enumerate(records(20)):
            if n % HOST_EVERY == HOST_EVERY - 1:
                pose = host_pose(n)
                # Taken before the record: it is not there yet.
                await bench.set(ctx, pose)
                await bench.bench.wait_until_low(ctx, bench.dut.o_waiting, at_most=600)
                sent.append(pose)
            await bench.send(ctx, record)
            (nowhere if record["causes"] else sent).append(record)
        await ctx.tick().repeat(300)

    bench.run(feed)
    in_order = sorted(map(repr, map(expected, sent)))
    assert sorted(map(repr, bench.received)) == in_order
    composed = [each for each in bench.received if each["composed"]]
    assert composed == [expected(each) for each in sent if not isinstance(each, dict)]
    assert bench.nowhere == [(int(record["frame"]) + 1) & 0xFFFF for record in nowhere]
    assert bench.counts == {"o_lost": 0, "o_ignored": 0}


def test_a_hosts_pose_goes_first_and_is_never_mixed() -> None:
    bench = PlacementsBench(pauses=Pauses())
    waiting = records(2)

    async def feed(ctx: Any) -> None:
        for record in waiting:
            await bench.send(ctx, record)
        await ctx.tick().repeat(30)
        # The first record is offered, and stays; the host's pose is the next, and no other takes its place.
        await bench.set(ctx, host_pose(7))
        await bench.set(ctx, host_pose(8))
        assert ctx.get(bench.dut.o_waiting)
        for _ in range(3):
            taken = await bench.bench.stream_get(ctx, bench.dut.o)
            bench.received.append({"elements": [taken.elements[n] for n in range(9)], "frame": taken.frame})
        assert not ctx.get(bench.dut.o_waiting)

    bench.run(feed, takes=False)
    wanted = [expected(each) for each in (waiting[0], host_pose(7), waiting[1])]
    assert bench.received == [{name: each[name] for name in ("elements", "frame")} for each in wanted]
    assert bench.counts == {"o_lost": 0, "o_ignored": 1}


def test_of_too_many_records_the_last_ones_are_lost_whole() -> None:
    bench = PlacementsBench(pauses=Pauses())
    sent = [record for record in records(18) if not record["causes"]]

    async def feed(ctx: Any) -> None:
        for record in sent:
            await bench.send(ctx, record)
        for _ in range(len(sent) - bench.counts["o_lost"]):
            taken = await bench.bench.stream_get(ctx, bench.dut.o)
            bench.received.append({"frame": taken.frame})

    bench.run(feed, takes=False)
    # One has left the queue for the output.
    assert bench.counts["o_lost"] == len(sent) - MAX_WAITING - 1
    assert bench.received == [{"frame": expected(each)["frame"]} for each in sent[: MAX_WAITING + 1]]


def test_what_is_no_whole_record_is_passed_over() -> None:
    """One that began while the switch was off, one of another type, and one that a reset cut."""
    bench = PlacementsBench(pauses=Pauses(gaps=60, stalls=60, seed=2))
    off, other, good = [record.copy() for record in records(12) if not record["causes"]][:3]
    other["tag"] = Tag.MATCH
    # Each of its words could be the first.
    cut = np.full(RECORD_WORDS, Tag.HOMOGRAPHY, np.uint64).view(HOMOGRAPHY.dtype)[0]

    async def feed(ctx: Any) -> None:
        ctx.set(bench.dut.i_enable, 0)
        await bench.send(ctx, off, words=3)
        ctx.set(bench.dut.i_enable, 1)
        await bench.send(ctx, off)
        await bench.send(ctx, other)
        await ctx.tick().repeat(100)
        assert not bench.received
        await bench.set(ctx, host_pose(3))
        await bench.send(ctx, cut, words=5)
        await ctx.tick().repeat(9)
        await bench.bench.pulse(ctx, bench.bench.reset)
        bench.received.clear()
        for n, word in enumerate(np.frombuffer(cut.tobytes(), np.uint64).tolist()[5:]):
            await bench.bench.stream_put(ctx, bench.dut.i, {"data": word, "last": n == 2})
        await bench.send(ctx, good)
        await ctx.tick().repeat(100)

    bench.run(feed)
    assert bench.received == [expected(good)]
    assert bench.nowhere == []
