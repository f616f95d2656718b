# amaranth: UnusedElaboratable=no
"""What stands between the registers and the painter: switch, settings, faults, counts and a host's poses.

The painter is a stand-in whose ports the tests set and see; `tests.system.test_camera_painter` has the real one.
"""

from typing import Any

import numpy as np
import pytest
from amaranth import Module
from amaranth.lib import wiring

from golden_model.config import MAX_FRAME_PX
from golden_model.painting.tiles import MAX_TILES
from golden_model.records import HOMOGRAPHY, Tag
from hdl.painting.frame_writer import frame_pages
from hdl.painting.painter import Painter
from hdl.registers.painter_register_map import PainterFault
from hdl.shell import painting
from hdl.shell.placements import MAX_WAITING
from tests.hdl.block_bench import BlockBench
from tests.hdl.shell.bench import registers

SIZE_PX = (640, 480)
PAGES = frame_pages(*SIZE_PX)
CANVAS, FRAMES = 0x12_3456_7000, 0xA_0000_1000
SETTINGS = {
    "painter_enable": 1,
    "painter_max_links": 9,
    "width_px": SIZE_PX[0],
    "height_px": SIZE_PX[1],
    "canvas_base_low": CANVAS & 0xFFFF_FFFF,
    "canvas_base_high": CANVAS >> 32,
    "canvas_columns": 3,
    "canvas_rows": MAX_TILES,
    "frames_base_low": FRAMES & 0xFFFF_FFFF,
    "frames_base_high": FRAMES >> 32,
    "frames_buffer_pages": PAGES,
    "picture_enable": 0,
    "picture_lines": 0,
}
TAKEN = {
    "i_max_links": 9,
    "i_width_px": SIZE_PX[0],
    "i_height_px": SIZE_PX[1],
    "i_canvas_page": CANVAS >> 12,
    "i_columns": 3,
    "i_rows": MAX_TILES,
    "i_frames_page": FRAMES >> 12,
    "i_buffer_pages": PAGES,
    "i_replace": 0,
}
SWITCH_CLOCKS = 4
"""From a register to the painter's switch."""


class StandIn(wiring.Component):
    """The painter's ports, and nothing behind them."""

    def __init__(self) -> None:
        super().__init__(Painter().signature)

    def elaborate(self, platform: object) -> Module:
        return Module()


class PaintingBench:
    """The block with registers; ``painter`` is the stand-in, which is idle at first."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **changes: int) -> None:
        self.registers, self.painter = registers(**SETTINGS | changes), StandIn()
        monkeypatch.setattr(painting, "Painter", lambda: self.painter)
        self.dut = painting.Painting(registers=self.registers)
        self.bench = BlockBench(self.dut)

    def run(self, testbench: Any) -> None:
        async def begin(ctx: Any) -> None:
            ctx.set(self.painter.o_idle, 1)
            await testbench(ctx)

        self.bench.run(begin)

    async def set(self, ctx: Any, **values: int) -> None:
        """Write registers, and wait until the painter's switch has followed."""
        for name, value in values.items():
            ctx.set(getattr(self.registers, f"o_{name}"), value)
        await ctx.tick().repeat(SWITCH_CLOCKS)

    async def send_record(self, ctx: Any, frame: int) -> None:
        """Send a record, all of whose elements are 0 but the last, -2."""
        record = np.zeros(1, HOMOGRAPHY.dtype)
        record["tag"], record["frame"], record["h22"] = Tag.HOMOGRAPHY, frame, (1 << 32) - 2
        for n, word in enumerate(record.view(np.uint64).tolist()):
            await self.bench.stream_put(ctx, self.dut.i_homographies, {"data": word, "last": n == 7})

    def get(self, ctx: Any, *names: str) -> list[int]:
        return [ctx.get(getattr(self.registers, f"i_{name}")) for name in names]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> PaintingBench:
    return PaintingBench(monkeypatch)


def test_settings_are_taken_while_nothing_is_under_way(bench: PaintingBench) -> None:
    dut, painter = bench.dut, bench.painter

    def taken(ctx: Any) -> dict[str, int]:
        return {name: ctx.get(getattr(painter, name)) for name in TAKEN}

    async def test(ctx: Any) -> None:
        await ctx.tick().repeat(SWITCH_CLOCKS)
        assert taken(ctx) == TAKEN
        assert (ctx.get(painter.i_enable), ctx.get(dut.o_idle)) == (1, 0)
        # What is written now waits, faults too, until the painter is off and idle.
        await bench.set(ctx, painter_replace=1, canvas_columns=0)
        ctx.set(painter.o_idle, 0)
        await bench.set(ctx, painter_enable=0)
        assert taken(ctx) == TAKEN
        assert (ctx.get(painter.i_enable), ctx.get(dut.o_idle)) == (0, 0)
        await bench.set(ctx, painter_enable=1, canvas_columns=7)
        assert ctx.get(painter.i_enable) == 0
        ctx.set(painter.o_idle, 1)
        await ctx.tick().repeat(SWITCH_CLOCKS)
        assert taken(ctx) == TAKEN | {"i_replace": 1, "i_columns": 7}
        assert ctx.get(painter.i_enable) == 1

    bench.run(test)


def test_a_stop_and_a_request_to_clear_wait_for_what_is_being_painted(bench: PaintingBench) -> None:
    dut, painter = bench.dut, bench.painter

    async def test(ctx: Any) -> None:
        await ctx.tick().repeat(SWITCH_CLOCKS)
        ctx.set(painter.o_idle, 0)
        ctx.set(dut.i_stop, 1)
        await ctx.tick().repeat(2)
        assert (ctx.get(painter.i_enable), ctx.get(dut.o_idle)) == (0, 0)
        ctx.set(painter.o_idle, 1)
        await ctx.tick().repeat(30)
        assert (ctx.get(painter.i_enable), ctx.get(dut.o_idle)) == (0, 1)
        ctx.set(dut.i_stop, 0)
        await ctx.tick().repeat(2)
        assert ctx.get(painter.i_enable) == 1
        ctx.set(painter.o_idle, 0)
        await bench.set(ctx, painter_clear=1)
        assert (ctx.get(painter.i_enable), ctx.get(painter.i_clear)) == (0, 0)
        ctx.set(painter.o_idle, 1)
        assert bench.get(ctx, "painter_clear") == [1] == [ctx.get(painter.i_clear)]

    bench.run(test)


OK, ALIGNED = PainterFault(0), 4096


REFUSALS: list[tuple[dict[str, int], PainterFault]] = [
    ({"canvas_base_low": ALIGNED + 128}, PainterFault.CANVAS_MISALIGNED),
    ({"frames_base_low": ALIGNED - 8}, PainterFault.FRAMES_MISALIGNED),
    ({"canvas_columns": 0}, PainterFault.CANVAS_SIZE),
    ({"canvas_rows": MAX_TILES + 1}, PainterFault.CANVAS_SIZE),
    ({"canvas_rows": 1}, OK),
    ({"frames_buffer_pages": PAGES - 1}, PainterFault.FRAMES_TOO_SMALL),
    ({"width_px": SIZE_PX[0] + 1}, PainterFault.FRAMES_TOO_SMALL),
    ({"width_px": 65, "height_px": 11, "frames_buffer_pages": 1}, PainterFault.FRAMES_TOO_SMALL),
    ({"width_px": 65, "height_px": 10, "frames_buffer_pages": 1}, OK),
    ({"width_px": MAX_FRAME_PX, "height_px": MAX_FRAME_PX, "frames_buffer_pages": 1 << 14}, OK),
    ({"width_px": 0}, PainterFault.FRAME_SIZE),
    ({"picture_enable": 1, "picture_lines": 0}, PainterFault.PICTURE_LINES),
    ({"picture_enable": 1, "picture_lines": 97, "canvas_rows": 3}, PainterFault.PICTURE_LINES),
    ({"picture_enable": 1, "picture_lines": 96, "canvas_rows": 3}, OK),
    ({"height_px": MAX_FRAME_PX + 1, "frames_buffer_pages": 1 << 15}, PainterFault.FRAME_SIZE),
]


def test_settings_that_cannot_work_keep_the_painter_off(bench: PaintingBench) -> None:
    async def test(ctx: Any) -> None:
        for changes, fault in REFUSALS:
            await bench.set(ctx, painter_enable=0, **changes)
            assert bench.get(ctx, "painter_refused") == [0]
            await bench.set(ctx, painter_enable=1)
            assert bench.get(ctx, "painter_refused") == [fault], changes
            assert ctx.get(bench.painter.i_enable) == (not fault)
            await bench.set(ctx, painter_enable=0, **{name: SETTINGS[name] for name in changes})

    bench.run(test)


@pytest.mark.parametrize("gray", [0, 1])
def test_pixels_reach_the_painter_in_colour_or_gray(bench: PaintingBench, gray: int) -> None:
    async def test(ctx: Any) -> None:
        await bench.set(ctx, gray_input=gray)
        ctx.set(bench.dut.i, {"data": 0xAABBCC, "first": 1, "last": 0})
        for valid in (1, 0):
            ctx.set(bench.dut.i_valid, valid)
            await ctx.tick()
            beat = ctx.get(bench.painter.i)
            assert (beat.valid, beat.data, beat.first, beat.last) == (valid, 0xCCCCCC if gray else 0xAABBCC, 1, 0)

    bench.run(test)


def test_everything_that_is_given_up_is_counted(bench: PaintingBench) -> None:
    painter = bench.painter
    events = {
        "frames_cut": painter.o_cut,
        "frames_lost": painter.o_lost,
        "frames_skipped": painter.o_skipped,
        "frames_unplaced": painter.o_unplaced,
        "pose_refused": painter.o_refused,
        "pose_unmatched": painter.o_unmatched,
        "pose_ignored": bench.registers.o_pose_set,
    }
    tiles = ("tiles_behind", "tiles_too_large", "tiles_failed")

    async def test(ctx: Any) -> None:
        await bench.bench.pulse(ctx, bench.registers.o_pose_set)
        ctx.set(painter.o_causes, 4)
        for clocks, (name, signal) in enumerate(events.items(), 1):
            ctx.set(signal, 1)
            await ctx.tick().repeat(clocks)
            ctx.set(signal, 0)
            await ctx.tick()
            counts = [n * (n <= clocks) for n in range(1, 8)]
            # A frame that was lost is an error of the memory.
            assert bench.get(ctx, *events, "painter_errors") == [*counts, clocks > 1], name
        assert bench.get(ctx, "pose_causes") == [4]
        ctx.set(bench.registers.o_pose_set, 1)
        await ctx.tick().repeat(300)
        assert bench.get(ctx, "pose_ignored") == [255]
        for number in (1, 5):
            of_tiles = {"behind": number, "too_large": 2, "failed": 3}
            ctx.set(painter.o.payload, {"frame": number, "counts": of_tiles})
            await bench.bench.pulse(ctx, painter.o.valid)
            assert ctx.get(painter.o.ready)
        assert bench.get(ctx, "frames_painted", "frames_last", *tiles) == [2, 4, 6, 4, 6]

    bench.run(test)


def test_what_a_host_holds_is_handed_on_and_counted_where_it_was_read_before(bench: PaintingBench) -> None:
    painter = bench.painter

    async def test(ctx: Any) -> None:
        ctx.set(painter.o_held, 1)
        ctx.set(painter.o_shown, 1)
        await bench.set(ctx, painter_enable=0, painter_replace=1)
        counts = []
        for flips, stop in ((0, 0), (0, 0), (1, 0), (0, 1)):
            await bench.set(ctx, painter_hold=1, painter_hold_row=5)
            assert (ctx.get(painter.i_holds[0].valid), ctx.get(painter.i_holds[0].row)) == (1, 5)
            assert bench.get(ctx, "painter_held", "painter_page") == [1, 1]
            # Nothing of the host's may keep a painter from ending.
            ctx.set(bench.dut.i_stop, stop)
            assert ctx.get(painter.i_holds[0].valid) != stop
            ctx.set(bench.dut.i_stop, 0)
            await bench.set(ctx, painter_hold=0)
            ctx.set(painter.o_flips, flips)
            await ctx.tick()
            ctx.set(painter.o_flips, 0)
            counts += bench.get(ctx, "pages_repeated")
        assert counts == [0, 1, 2, 2]

    bench.run(test)


def test_an_error_of_the_memory_in_a_tile_is_told(bench: PaintingBench) -> None:
    painter = bench.painter

    async def test(ctx: Any) -> None:
        ctx.set(painter.o.payload.counts.has_errors, 1)
        await ctx.tick()
        assert bench.get(ctx, "painter_errors") == [0]
        await bench.bench.pulse(ctx, painter.o.valid)
        await ctx.tick()
        assert bench.get(ctx, "painter_errors") == [1]

    bench.run(test)


def test_a_host_sees_what_became_of_its_pose(bench: PaintingBench) -> None:
    """Kept or refused, and which record had been taken before; and how many records have been lost."""
    painter = bench.painter
    status = ("pose_waiting", "pose_answer", "pose_newest")

    async def take(ctx: Any, *, causes: int = 0) -> tuple[int, int]:
        while not ctx.get(painter.i_poses.valid):
            await ctx.tick()
        found = (ctx.get(painter.i_poses.payload.frame), ctx.get(painter.i_poses.payload.composed))
        assert ctx.get(painter.i_poses.payload.elements[8]) == (found[1] - 3)
        ctx.set(painter.o_refused, causes > 0)
        # Without a refusal they mean nothing.
        ctx.set(painter.o_causes, causes or 8)
        await bench.bench.pulse(ctx, painter.i_poses.ready)
        ctx.set(painter.o_refused, 0)
        return found

    async def test(ctx: Any) -> None:
        await bench.set(ctx, pose_frame=41, pose_h22=(1 << 32) - 3)
        await bench.send_record(ctx, 41)
        assert await take(ctx) == (42, 1)
        await bench.bench.pulse(ctx, bench.registers.o_pose_set)
        await ctx.tick()
        assert bench.get(ctx, *status) == [1, 0, 0]
        assert await take(ctx) == (42, 0)
        assert bench.get(ctx, *status) == [0, 0, 41]
        await bench.bench.pulse(ctx, bench.registers.o_pose_set)
        assert await take(ctx, causes=2) == (42, 0)
        assert bench.get(ctx, *status) == [0, 2, 41]
        for frame in range(MAX_WAITING + 3):
            await bench.send_record(ctx, frame)
        await ctx.tick()
        assert bench.get(ctx, "pose_lost") == [2]

    bench.run(test)


def test_what_waits_is_forgotten_and_no_record_is_taken_while_the_painter_is_off(bench: PaintingBench) -> None:
    offers = bench.painter.i_poses.valid

    async def test(ctx: Any) -> None:
        await bench.set(ctx)
        await bench.send_record(ctx, 3)
        await bench.bench.pulse(ctx, bench.registers.o_pose_set)
        await bench.set(ctx)
        assert (ctx.get(offers), *bench.get(ctx, "pose_waiting")) == (1, 1)
        await bench.set(ctx, painter_enable=0, painter_clear=1)
        await bench.set(ctx, painter_clear=0)
        assert (ctx.get(offers), *bench.get(ctx, "pose_waiting")) == (0, 0)
        await bench.send_record(ctx, 4)
        await bench.set(ctx)
        assert not ctx.get(offers)

    bench.run(test)
