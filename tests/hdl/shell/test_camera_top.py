"""From the camera to the front end's admission a broken frame costs itself alone; and all outputs are driven."""

import dataclasses
import functools
import itertools
from collections.abc import Iterator
from typing import Any

from amaranth import Cat, DomainRenamer, Module, Signal
from amaranth.hdl import Fragment, Value
from amaranth.lib import wiring
from amaranth.sim import Simulator

from golden_model.config import PRESETS, EstimatorConfig
from golden_model.records import Cause
from hdl.axi.video_input import VideoInput
from hdl.build import BUILDS
from hdl.frame_admission import FrameAdmission
from hdl.lib.skid_buffer import SkidBuffer
from hdl.shell.camera import CameraCrossing, CameraGate
from hdl.shell.camera_top import CameraAccelerator
from tests.hdl.block_bench import CLOCK_S


def causes(size_px: tuple[int, int], *, closing_lines: int, depth: int) -> list[int]:
    """How a frame ends whose second line is short, and the whole one right behind it, of a camera without pauses."""
    m = Module()
    m.submodules.crossing = crossing = DomainRenamer({"camera": "sync"})(CameraCrossing(video_bits=8, depth=depth))
    m.submodules.gate = gate = CameraGate()
    m.submodules.skid_buffer = skid_buffer = SkidBuffer(shape=gate.o.payload.shape())
    m.submodules.video_input = video_input = VideoInput(video_bits=8)
    m.submodules.admission = admission = FrameAdmission(closing_lines=closing_lines)
    for source, sink in itertools.pairwise((crossing, gate, skid_buffer, video_input, admission)):
        wiring.connect(m, source.o, sink.i)
    high = [gate.i_on, gate.i_has_room, video_input.i_gray_input]
    high += [admission.i_acceptable, admission.i_may_start, admission.i_may_end]
    m.d.comb += [gate.i_pressed.eq(crossing.o_pressed), Cat(high).eq(-1)]
    for block in (gate, admission):
        m.d.comb += [block.i_width_px.eq(size_px[0]), block.i_height_px.eq(size_px[1])]
    ended: list[int] = []

    async def camera(ctx: Any) -> None:
        await ctx.tick().repeat(8)
        for length_px, first in [(size_px[0], 1), (3, 0), *((size_px[0], n == 0) for n in range(size_px[1]))]:
            # Steps of many clocks: nothing but the marks at a line's ends changes.
            for clocks, marks in ((1, first << 1), (length_px - 2, 0), (1, 1 << 2)):
                ctx.set(Cat(crossing.i_valid, crossing.i.first, crossing.i.last), 1 | marks)
                await ctx.delay(clocks * CLOCK_S)
        ctx.set(crossing.i_valid, 0)
        await ctx.delay(2 * depth * CLOCK_S)

    async def watch(ctx: Any) -> None:
        while True:
            await ctx.posedge(admission.o_end)
            ended.append(ctx.get(admission.o_causes))

    simulator = Simulator(m)
    simulator.add_clock(CLOCK_S)
    simulator.add_testbench(camera)
    simulator.add_testbench(watch, background=True)
    simulator.run()
    return ended


@functools.cache
def build_camera(border_px: int, max_width_px: int) -> CameraAccelerator:
    """Kept: Amaranth warns of parts that are built and not used."""
    config = PRESETS["aerial"]
    config = dataclasses.replace(config, front_end=dataclasses.replace(config.front_end, border_px=border_px))
    return CameraAccelerator(dataclasses.replace(BUILDS["camera"], config=config, max_width_px=max_width_px))


def test_the_frame_behind_a_short_line_is_whole_where_a_wide_border_takes_long_to_close() -> None:
    core = build_camera(40, 65)
    closing_lines = max(level.closing_lines for level in core.accelerator._front_end.levels)
    found = causes((65, 65), closing_lines=closing_lines, depth=core._shell._crossing.depth)
    assert found == [Cause.EARLY_END, 0]


def list_driven(fragment: Fragment) -> Iterator[Signal]:
    """The signals that anything below assigns."""
    for statements in fragment.statements.values():
        for statement in statements:
            yield from statement._lhs_signals()
    for inner, *_ in fragment.subfragments:
        yield from list_driven(inner)


def test_every_output_that_a_build_uses_is_driven() -> None:
    config = dataclasses.replace(BUILDS["tiny"].config, estimator=EstimatorConfig())
    small = dataclasses.replace(BUILDS["camera"], config=config, lanes=2, max_width_px=128, max_height_px=128)
    core = CameraAccelerator(dataclasses.replace(small, painter=True))
    driven = {id(signal) for signal in list_driven(Fragment.get(core, None))}
    used = (*core.ports, "control", "o_interrupt")
    outputs = [
        (path, Value.cast(value)._lhs_signals())
        for path, member, value in core.signature.flatten(core)
        if member.flow == wiring.Out and path[0] in used
    ]
    assert {path[0] for path, _ in outputs} == set(used)
    assert [path for path, signals in outputs if any(id(signal) not in driven for signal in signals)] == []
