"""The crossing loses no pixel unsaid, and the gate passes whole frames or says why not; one row for each reason."""

from collections.abc import Sequence
from typing import Any

import pytest
from amaranth import ClockDomain, Module
from amaranth.sim import Simulator

from hdl.registers.shell_register_map import Reason
from hdl.shell.camera import CameraCrossing, CameraGate
from tests.hdl.block_bench import CLOCK_S, BlockBench, Testbench

WIDTH_PX, HEIGHT_PX = 6, 3
Beat = dict[str, int]


def frame(number: int, width: int = WIDTH_PX, height: int = HEIGHT_PX) -> list[Beat]:
    """Beats behind the crossing."""
    count = width * height
    return [
        {"data": 32 * number + n, "first": n == 0, "last": n % width == width - 1, "lost": 0, "number": number}
        for n in range(count)
    ]


class GateBench:
    """Sends beats through the gate, and keeps the pixels that pass by the number of their frame."""

    def __init__(self, **settings: int) -> None:
        usual = {"i_on": 1, "i_has_room": 1, "i_width_px": WIDTH_PX, "i_height_px": HEIGHT_PX}
        self.gate = CameraGate()
        self.bench = BlockBench(self.gate, settings=usual | settings, cycle_limit=1000)
        self.passed: dict[int, list[int]] = {}
        self.admitted: list[int] = []
        self.values: dict[str, int] = {}
        self.last_drop: tuple[int, int] | None = None
        self.drops = 0

    def run(self, beats: list[Beat], *, off: int | None = None, others: Sequence[Testbench] = ()) -> None:
        """Send beats; before the one with the number ``off`` the gate is switched off."""

        async def camera(ctx: Any) -> None:
            ctx.set(self.gate.o.ready, 1)
            await ctx.tick().repeat(2)
            for number, beat in enumerate(beats):
                if number == off:
                    ctx.set(self.gate.i_on, 0)
                await self.bench.stream_put(ctx, self.gate.i, beat)
            await ctx.tick()
            names = ("frames", "dropped", "cut", "reason")
            self.values = {name: ctx.get(getattr(self.gate, f"o_{name}")) for name in names}
            last = ctx.get(self.gate.o_last_drop)
            self.last_drop = (last.number, last.time)

        self.bench.run(camera, background=[self._watch, *others])

    async def _watch(self, ctx: Any) -> None:
        gate = self.gate
        sampled = (gate.o.valid, gate.o.ready, gate.o.payload, gate.o_admits, gate.o_info, gate.o_drops)
        async for *_, valid, ready, pixel, admits, info, drops in ctx.tick().sample(*sampled):
            self.drops += drops
            if admits:
                self.admitted.append(info.number)
            if valid and ready:
                self.passed.setdefault(pixel.data // 32, []).append(pixel.data % 32)


WHOLE = list(range(WIDTH_PX * HEIGHT_PX))


@pytest.mark.parametrize(
    ("settings", "reason", "drops"),
    [
        ({"i_on": 0}, Reason.OFF, 0),
        ({"i_refused": 1}, Reason.REFUSED, 2),
        ({"i_has_room": 0}, Reason.NO_BUFFER, 2),
        ({"i_refused": 1, "i_has_room": 0}, Reason.REFUSED, 2),
    ],
)
def test_a_frame_is_dropped_whole_for_a_reason(settings: dict[str, int], reason: Reason, drops: int) -> None:
    bench = GateBench(i_time=77, **settings)
    bench.run([*frame(1), *frame(2)])
    assert not bench.passed
    assert bench.last_drop == (2, 77)
    assert bench.values == {"frames": 2, "dropped": 2, "cut": 0, "reason": reason}
    assert bench.drops == drops


def lose(beats: list[Beat], position: int) -> list[Beat]:
    """The crossing was full: some pixels are gone, and the next one says so."""
    return [*beats[:position], {**beats[position + 2], "lost": 1}, *beats[position + 3 :]]


@pytest.mark.parametrize(
    ("broken", "kept"),
    [
        # Up to the pixel where the line should end, or the one with which it ends too early.
        (frame(1, width=WIDTH_PX + 1), WIDTH_PX - 1),
        (frame(1, width=WIDTH_PX - 1), WIDTH_PX - 2),
        (lose(frame(1), 8), 8),
        (frame(1)[:10], 10),
        (frame(1, width=1), 1),
    ],
    ids=["long line", "short line", "lost pixels", "next frame", "one pixel"],
)
def test_a_frame_is_cut_off_where_it_breaks_and_the_next_one_is_whole(broken: list[Beat], kept: int) -> None:
    bench = GateBench()
    bench.run([*broken, *frame(2)])
    assert bench.passed == {1: list(range(kept)), 2: WHOLE}
    assert bench.values == {"frames": 2, "dropped": 0, "cut": 1, "reason": 0}
    assert bench.drops == 1


def test_a_gate_that_is_switched_off_cuts_the_frame_under_way_and_reports_no_drop() -> None:
    bench = GateBench()
    bench.run([*frame(1), *frame(2)], off=WIDTH_PX * HEIGHT_PX + 7)
    assert bench.passed == {1: WHOLE, 2: list(range(7))}
    assert bench.values == {"frames": 2, "dropped": 0, "cut": 1, "reason": 0}
    assert bench.drops == 0


def test_the_buffers_of_a_frame_are_counted_before_the_next_one_is_admitted() -> None:
    """However short that frame is: what the shell has counted reaches the gate a clock later."""
    bench = GateBench()

    async def take_the_last(ctx: Any) -> None:
        await ctx.tick().until(bench.gate.o_admits)
        ctx.set(bench.gate.i_has_room, 0)

    bench.run([*frame(1, width=1, height=1), *frame(2)], others=[take_the_last])
    assert bench.passed == {1: [0]}
    assert bench.values == {"frames": 2, "dropped": 1, "cut": 1, "reason": Reason.NO_BUFFER}


def test_frames_of_which_no_pixel_came_count_as_dropped() -> None:
    bench = GateBench()
    bench.run([*frame(1), *frame(4)])
    assert bench.admitted == [1, 4]
    assert bench.values == {"frames": 4, "dropped": 2, "cut": 0, "reason": Reason.OUTRUN}


@pytest.mark.parametrize("camera_s", [1.37 * CLOCK_S, 0.61 * CLOCK_S])
def test_pixels_cross_in_order_and_what_is_lost_is_told(camera_s: float) -> None:
    """At a camera's clock that is slower, none is lost; at one that is faster, the queue overflows."""
    depth, frames, count = 32, 12, 17
    m = Module()
    m.domains.camera = ClockDomain()
    m.submodules.crossing = dut = CameraCrossing(video_bits=24, depth=depth)
    sent = [(number, n) for number in range(1, frames + 1) for n in range(count)]
    received: list[Any] = []
    pressed = [0]

    async def camera(ctx: Any) -> None:
        # Amaranth's queue takes some clocks after its reset.
        await ctx.tick("camera").repeat(8)
        ctx.set(dut.i_valid, 1)
        for number, n in sent:
            ctx.set(dut.i, {"data": number << 12 | n, "first": n == 0, "last": n == count - 1})
            await ctx.tick("camera")
        ctx.set(dut.i_valid, 0)
        await ctx.tick("sync").repeat(2 * depth)

    async def take(ctx: Any) -> None:
        ctx.set(dut.o.ready, 1)
        sampled = (dut.o.valid, dut.o.payload, dut.o_pressed)
        async for *_, valid, pixel, is_pressed in ctx.tick("sync").sample(*sampled):
            pressed[0] |= is_pressed
            if valid:
                received.append((pixel.number, pixel.data, pixel.first, pixel.last, pixel.lost))

    simulator = Simulator(m)
    simulator.add_clock(CLOCK_S, domain="sync")
    simulator.add_clock(camera_s, phase=0.3 * camera_s, domain="camera")
    simulator.add_testbench(camera)
    simulator.add_testbench(take, background=True)
    simulator.run()
    arrived = [(data >> 12, data & 0xFFF) for _, data, *_ in received]
    assert arrived == sorted(set(arrived))
    assert set(arrived) <= set(sent)
    assert all(number == at[0] for (number, *_), at in zip(received, arrived, strict=True))
    assert all(
        (first, last) == (n == 0, n == count - 1)
        for (_, _, first, last, _), (_, n) in zip(received, arrived, strict=True)
    )
    # The pixel behind each gap says so, and no other.
    order = [sent.index(at) for at in arrived]
    assert [lost for *_, lost in received] == [
        after - before > 1 for before, after in zip([-1, *order], order, strict=False)
    ]
    overflows = camera_s < CLOCK_S
    assert (len(arrived) < len(sent)) == overflows == bool(pressed[0])
