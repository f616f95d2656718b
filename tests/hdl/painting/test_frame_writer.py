"""Frames in three buffers: each is whole, none is overwritten while it is painted, and the camera never waits."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hdl.painting.frame_writer import BUFFERS, BURST_PX, PIXEL_BYTES, FrameWriter
from hdl.settings import PAGE_BYTES
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench, Testbench
from tests.hdl.shell.axi_memory import AxiMemory

BASE, WIDTH_PX, HEIGHT_PX, BUFFER_PAGES = 0x7_0000_1000, 41, 7, 2
"""Rows of two bursts, the last of them short and with an odd pixel; a page more than a frame needs."""
UNTOUCHED = 0xA5


class WriterBench:
    """A writer with a memory; a painter that takes a frame and then none for ``paints_clocks``.

    With ``paints_clocks`` -1 it never takes one.
    """

    def __init__(self, *, paints_clocks: int = 10, **rules: Any) -> None:
        self.memory = AxiMemory(BASE, BUFFERS * BUFFER_PAGES * PAGE_BYTES, **rules)
        self.memory.bytes[:] = UNTOUCHED
        self.dut = FrameWriter()
        settings = {"i_enable": 1, "i_page": BASE // PAGE_BYTES, "i_buffer_pages": BUFFER_PAGES}
        settings |= {"i_width_px": WIDTH_PX, "i_height_px": HEIGHT_PX}
        self.bench = BlockBench(self.dut, settings=settings, cycle_limit=20_000)
        self.paints_clocks = paints_clocks
        self.paints = False
        self.painted: list[tuple[int, NDArray[np.uint8]]] = []
        self.counts = {"o_cut": 0, "o_failed": 0, "o_skipped": 0}

    def picture(self, buffer: int) -> NDArray[np.uint8]:
        """A frame as it is in memory; what lies behind its rows is as it was."""
        stride = -(-WIDTH_PX // BURST_PX) * BURST_PX
        size = HEIGHT_PX * stride * PIXEL_BYTES
        start = buffer * BUFFER_PAGES * PAGE_BYTES
        rows = self.memory.bytes[start : start + size].reshape(HEIGHT_PX, stride, PIXEL_BYTES).copy()
        # The word of the last, odd pixel has another behind it.
        assert (rows[:, WIDTH_PX + 1 :] == UNTOUCHED).all()
        assert not rows[:, :WIDTH_PX, 3].any()
        return rows[:, :WIDTH_PX, :3]

    def run(self, frames: Sequence[Any], *, gaps: int = 0, others: Sequence[Testbench] = ()) -> None:
        """Send frames one behind the other: pictures, or lists of lines."""
        dut, pauses = self.dut, Pauses(gaps=gaps, seed=3)

        async def send(ctx: Any) -> None:
            clock = 0
            await ctx.tick().repeat(3)
            for lines in frames:
                for y, line in enumerate(lines):
                    for x, (blue, green, red) in enumerate(line.tolist()):
                        while pauses.gap(clock := clock + 1):
                            ctx.set(dut.i.valid, 0)
                            await ctx.tick()
                        data = green | blue << 8 | red << 16
                        beat = {"valid": 1, "data": data, "first": not (x or y), "last": x == len(line) - 1}
                        ctx.set(dut.i, beat)
                        await ctx.tick()
                ctx.set(dut.i.valid, 0)
                await ctx.tick().repeat(160)
            while not ctx.get(dut.o_idle) or self.paints:
                await ctx.tick()

        self.bench.run(send, background=[self.memory.port(dut.bus), self._paint, self._count, *others])

    async def _paint(self, ctx: Any) -> None:
        dut = self.dut
        while self.paints_clocks >= 0:
            frame = await self.bench.stream_get(ctx, dut.o)
            assert frame.page == BASE // PAGE_BYTES + frame.buffer * BUFFER_PAGES
            self.paints, before = True, self.picture(frame.buffer)
            await ctx.tick().repeat(self.paints_clocks)
            after = self.picture(frame.buffer)
            assert (after == before).all(), "overwritten while it was painted"
            self.painted.append((frame.number, after))
            self.paints = bool(ctx.get(dut.o.valid))

    async def _count(self, ctx: Any) -> None:
        """Count what happens; a writer that is idle waits for no answer of the memory."""
        bus, unanswered = self.dut.bus, 0
        ports = (bus.awvalid & bus.awready, bus.bvalid & bus.bready, self.dut.o_idle)
        async for *_, begins, ends, is_idle, cut, failed, skipped in ctx.tick().sample(
            *ports, *(getattr(self.dut, name) for name in self.counts)
        ):
            assert not (is_idle and unanswered)
            unanswered += int(begins) - int(ends)
            for name, happens in zip(self.counts, (cut, failed, skipped), strict=True):
                self.counts[name] += happens


def frame(number: int) -> NDArray[np.uint8]:
    return np.random.default_rng(number).integers(0, 256, (HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8)


def check(bench: WriterBench, expected: dict[int, NDArray[np.uint8]], **counts: int) -> None:
    assert [number for number, _ in bench.painted] == list(expected)
    for (_, picture), sent in zip(bench.painted, expected.values(), strict=True):
        np.testing.assert_array_equal(picture, sent)
    assert bench.counts == dict.fromkeys(bench.counts, 0) | counts


@pytest.mark.parametrize(
    ("count", "rules", "gaps"),
    [(4, {"waits": 43, "latency_clocks": 119, "seed": 1}, 40), (2, {"data_first": True, "waits": 43}, 0)],
    ids=["slow", "data first"],
)
def test_frames_arrive_whole(count: int, rules: dict[str, Any], gaps: int) -> None:
    bench = WriterBench(**rules)
    frames = [frame(number) for number in range(count)]
    bench.run(frames, gaps=gaps)
    check(bench, dict(enumerate(frames, 1)))


def test_a_slow_painter_gets_some_of_the_frames() -> None:
    bench = WriterBench(paints_clocks=900)
    frames = [frame(number) for number in range(4)]
    bench.run(frames)
    # While the first is painted, the second waits, and the third finds no room.
    check(bench, {n: frames[n - 1] for n in (1, 2, 4)}, o_skipped=1)


def test_a_frame_of_another_size_is_cut_off() -> None:
    bench = WriterBench(waits=43, latency_clocks=119)
    good = [frame(number) for number in range(7)]
    short = list(good[1][:4])
    narrow = [*good[3][:3], good[3][3][:-1], *good[3][4:]]
    wide = [*good[5][:3], np.vstack([good[5][3], good[5][3][:1]]), *good[5][4:]]
    bench.run([good[0], short, good[2], narrow, good[4], wide, good[6]])
    # The short one is found out when the next starts, which is lost with it.
    check(bench, {1: good[0], 5: good[4], 7: good[6]}, o_cut=4)


def test_last_lines_of_another_width_and_lines_behind_the_last_are_found_out() -> None:
    """Lines behind the last are counted and not kept."""
    bench = WriterBench()
    wide, narrow = (np.resize(frame(0)[-1], (WIDTH_PX + change, 3)) for change in (1, -1))
    parts = [[*frame(0)[:-1], wide], frame(1), [*frame(2)[:-1], narrow], [*frame(3), *frame(4)[:2]], frame(5)]
    bench.run(parts)
    check(bench, {2: frame(1), 4: frame(3), 5: frame(5)}, o_cut=3)


def test_a_memory_that_stands_still_costs_a_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """The queue runs full: what is in it is given up, and the camera does not wait."""
    monkeypatch.setattr("hdl.painting.frame_writer.QUEUE_WORDS", 32)
    bench = WriterBench()
    frames = [frame(number) for number in range(4)]

    async def stop(ctx: Any) -> None:
        # Within the second frame.
        await ctx.tick().repeat(WIDTH_PX * HEIGHT_PX + 200)
        bench.memory.stuck = True
        await ctx.tick().repeat(200)
        bench.memory.stuck = False

    bench.run(frames, others=[stop])
    check(bench, {1: frames[0], 3: frames[2], 4: frames[3]}, o_cut=1)


def test_a_frame_with_an_error_of_the_memory_is_given_up() -> None:
    bench = WriterBench(errors=9, seed=3)
    frames = [frame(number) for number in range(3)]
    bench.run(frames)
    assert 0 < bench.counts["o_failed"] < 3
    assert len(bench.painted) == 3 - bench.counts["o_failed"]
    for number, picture in bench.painted:
        np.testing.assert_array_equal(picture, frames[number - 1])


def test_a_switch_takes_whole_frames() -> None:
    bench = WriterBench()
    frames = [frame(number) for number in range(3)]

    async def switch(ctx: Any) -> None:
        # Within the first frame, which is cut off, and within the second.
        await ctx.tick().repeat(150)
        ctx.set(bench.dut.i_enable, 0)
        await ctx.tick().repeat(WIDTH_PX * HEIGHT_PX + 100)
        ctx.set(bench.dut.i_enable, 1)

    bench.run(frames, others=[switch])
    check(bench, {3: frames[2]}, o_cut=1)


@pytest.mark.parametrize("lines", [1, HEIGHT_PX - 1], ids="after {} lines".format)
def test_a_switch_ends_the_frame_of_a_camera_that_has_stopped(lines: int) -> None:
    """Whatever has arrived of it; the one before is withdrawn, which a new size could not be painted with."""
    bench = WriterBench(paints_clocks=-1)
    waits: list[int] = []

    async def switch(ctx: Any) -> None:
        await ctx.tick().repeat(WIDTH_PX * HEIGHT_PX + 180 + lines * WIDTH_PX)
        for _ in range(2):
            assert not ctx.get(bench.dut.o_idle)
            waits.append(ctx.get(bench.dut.o.valid))
            ctx.set(bench.dut.i_enable, 0)
            await ctx.tick()

    # The bench waits until the writer is idle.
    bench.run([frame(0), frame(1)[:lines]], others=[switch])
    assert waits == [1, 0]
    assert bench.counts == {"o_cut": 1, "o_failed": 0, "o_skipped": 0}
