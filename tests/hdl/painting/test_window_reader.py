"""Windows hold what is in memory at their place, and are never written while they are painted."""

import random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdl.painting.frame_writer import BURST_PX, PIXEL_BYTES
from hdl.painting.window_reader import WindowReader
from hdl.settings import PAGE_BYTES
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.shell.axi_memory import AxiMemory

BASE, WIDTH_PX, HEIGHT_PX, WINDOW_PX = 0x12_3456_7000, 301, 200, 128
STRIDE_PX = -(-WIDTH_PX // BURST_PX) * BURST_PX
NARROW_PX = WINDOW_PX // 2
Box = tuple[int, int, int, int]
BLANK = (0, 0, 0, 0)


class ReaderBench:
    """A reader with a memory; a painter that looks at each window while it has it."""

    def __init__(self, *, paints_clocks: int = 1, pauses: Pauses = NO_PAUSES, **rules: Any) -> None:
        self.memory = AxiMemory(BASE, HEIGHT_PX * STRIDE_PX * PIXEL_BYTES, **rules)
        self.memory.bytes[:] = np.random.default_rng(1).integers(0, 256, self.memory.bytes.size)
        self.frame = self.memory.bytes.reshape(HEIGHT_PX, STRIDE_PX, PIXEL_BYTES)[:, :WIDTH_PX, :3]
        self.dut = WindowReader()
        settings = {"i_width_px": WIDTH_PX, "i_page": BASE // PAGE_BYTES}
        self.bench = BlockBench(self.dut, settings=settings, pauses=pauses, cycle_limit=30_000)
        self.paints_clocks = paints_clocks
        self.windows = np.zeros((WINDOW_PX, WINDOW_PX, 3), np.int64)
        self.blanks: list[int] = []
        self.failed = self.clocks = 0

    def run(self, boxes: list[Box], *, restart: bool = False) -> None:
        async def send(ctx: Any) -> None:
            for number, box in enumerate(boxes):
                corners = [{"x": 1000 * number + n, "y": -n} for n in range(9)]
                sides = dict(zip(("left", "top", "right", "bottom"), box, strict=True))
                plan = {"tile": {"column": 1, "row": 2}, "corners": corners, **sides, "wide": is_wide(box)}
                await self.bench.stream_put(ctx, self.dut.i, plan | {"painted": 1, "blank": box == BLANK})

        async def paint(ctx: Any) -> None:
            for number, box in enumerate(boxes):
                while not ctx.get(self.dut.o.valid):
                    await ctx.tick()
                tile = ctx.get(self.dut.o.payload)
                assert (tile.corners[8].x, tile.corners[8].y) == (1000 * number + 8, -8)
                self.blanks.append(tile.blank)
                assert tile.wide == is_wide(box)
                before = self.look(tile.window, box)
                await ctx.tick().repeat(self.paints_clocks)
                if not tile.blank:
                    np.testing.assert_array_equal(before, self.cut(box))
                    np.testing.assert_array_equal(self.look(tile.window, box), before)
                await self.bench.stream_get(ctx, self.dut.o)

        self.bench.run(send, paint, background=[self.memory.read_port(self.dut.bus), self._write])

    def cut(self, box: Box) -> NDArray[np.int64]:
        left, top, right, bottom = box
        return self.frame[top : bottom + 1, left : right + 1].astype(np.int64)

    def look(self, window: int, box: Box) -> NDArray[np.int64]:
        """What is in the window at the place of a box."""
        left, top, right, bottom = box
        y, x = np.mgrid[top : bottom + 1, left : right + 1] % WINDOW_PX
        return self.windows[y, x if is_wide(box) else x % NARROW_PX + NARROW_PX * window]

    async def _write(self, ctx: Any) -> None:
        """The windows' memory."""
        async for *_, write, failed in ctx.tick().sample(self.dut.o_write, self.dut.o_failed):
            self.failed += failed
            self.clocks += 1
            for n in range(2):
                if write.valid and write.kept[n]:
                    self.windows[write.y, 2 * write.x + n] = list(write.pixels[n])


def is_wide(box: Box) -> bool:
    return box[2] - box[0] >= NARROW_PX


def boxes(count: int, seed: int) -> list[Box]:
    rng = random.Random(seed)
    result = []
    for _ in range(count):
        width_px, height_px = rng.randint(1, WINDOW_PX), rng.randint(1, 12)
        left, top = rng.randint(0, WIDTH_PX - width_px), rng.randint(0, HEIGHT_PX - height_px)
        result.append((left, top, left + width_px - 1, top + height_px - 1))
    return result


EXTREMES = [
    # 64 and 128 px that begin at an odd and at an even x, one pixel, one at each end, and 128 rows.
    (31, 0, 94, 1),
    (31, 2, 158, 3),
    (32, 2, 95, 3),
    (32, 3, 159, 4),
    (40, 3, 104, 4),
    (33, 7, 33, 7),
    (0, 0, 0, 0 + HEIGHT_PX - 1 - 190),
    (300, 199, 300, 199),
    BLANK,
    (299, 72, 300, 199),
    BLANK,
    (173, 190, 300, 199),
]


def test_windows_hold_what_is_in_memory() -> None:
    pauses = Pauses(gaps=100, stalls=100, seed=2)
    bench = ReaderBench(paints_clocks=100, pauses=pauses, waits=43, latency_clocks=20, seed=1)
    sent = [*EXTREMES, *boxes(3, seed=3)]
    bench.run(sent)
    assert bench.blanks == [box == BLANK for box in sent]
    assert not bench.failed


def test_a_window_with_an_error_is_blank_and_the_next_is_not() -> None:
    bench = ReaderBench(errors=8, seed=3)
    bench.run(boxes(8, seed=4))
    assert 0 < bench.failed == sum(bench.blanks) < 8


def test_a_window_is_read_while_another_is_painted() -> None:
    bench, sent = ReaderBench(paints_clocks=512, waits=43, latency_clocks=119, seed=5), [(1, 2, 40, 18)] * 3
    bench.run(sent)
    # The first is waited for; the others are there when the one before has been painted.
    assert bench.clocks < 5 * 512
