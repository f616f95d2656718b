# amaranth: UnusedElaboratable=no
"""Beats of every width of the video port, cut into pixels."""

from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest
from amaranth import Cat, Module
from amaranth.lib import wiring
from amaranth.sim import Simulator

from hdl.axi.video_input import VideoInput
from hdl.blocks.axi import make_video_input
from hdl.blocks.pixel import BlockConfig
from hdl.build import VIDEO_BITS, Build, pixels_per_clock
from hdl.frame_admission import FrameAdmission
from sim.benches.exported import host_programs
from tests.hdl.block_bench import CLOCK_S
from tests.hdl.rows import row_test

test_rows = row_test({
    f"{bits} bits {'gray' if gray else 'colour'} {'memory' if memory else 'video'}": partial(
        make_video_input, BlockConfig(video_bits=bits), memory_mode=memory, gray=gray
    )
    for bits, memory, gray in product(VIDEO_BITS["streams"], (0, 1), (0, 1))
    if bits not in (8, 16) or gray
})  # fmt: skip


def test_other_widths_are_refused() -> None:
    with pytest.raises(ValueError, match="32, 24, 8, 48, 16"):
        VideoInput(video_bits=12)


def admitted(video_bits: int, transfers: list[bytes], size_px: tuple[int, int]) -> list[tuple[int, int]]:
    """For each frame that the admission makes of gray transfers: the causes, and how many beats it has."""
    m = Module()
    m.submodules.video_input = dut = VideoInput(video_bits=video_bits)
    m.submodules.admission = admission = FrameAdmission(closing_lines=1, pixels_per_clock=dut.pixels_per_clock)
    wiring.connect(m, dut.o, admission.i)
    high = [dut.i_memory_mode, dut.i_gray_input, admission.i_memory_mode]
    high += [admission.i_acceptable, admission.i_may_start, admission.i_may_end]
    m.d.comb += [
        Cat(high).eq(-1),
        dut.i_frame_ends.eq(admission.o_frame_ends),
        Cat(admission.i_width_px, admission.i_height_px).eq(size_px[0] | size_px[1] << len(admission.i_width_px)),
    ]
    frames, beats = [], [0]

    async def send(ctx: Any) -> None:
        await ctx.tick().repeat(4)
        step = video_bits // 8
        for transfer in transfers:
            for at in range(0, len(transfer), step):
                data = int.from_bytes(transfer[at : at + step], "little")
                ctx.set(dut.i.payload, {"data": data, "first": 0, "last": int(at + step >= len(transfer))})
                ctx.set(dut.i.valid, 1)
                await ctx.tick().until(dut.i.ready)
        ctx.set(dut.i.valid, 0)
        await ctx.tick().repeat(2 * size_px[0] * size_px[1])

    async def watch(ctx: Any) -> None:
        async for *_, valid, ends, causes in ctx.tick().sample(admission.o.valid, admission.o_end, admission.o_causes):
            beats[0] += valid
            if ends:
                frames.append((causes, beats[0]))
                beats[0] = 0

    simulator = Simulator(m)
    simulator.add_clock(CLOCK_S)
    simulator.add_testbench(send)
    simulator.add_testbench(watch, background=True)
    simulator.run()
    return frames


@pytest.mark.parametrize("video_bits", VIDEO_BITS["streams"])
def test_frames_of_odd_size_from_the_driver_follow_each_other(video_bits: int) -> None:
    width, height = 9, 5
    gray = np.arange(width * height, dtype=np.uint8).reshape(height, width)
    with host_programs(Build(video_bits=video_bits)) as load:
        sent = load("skymosaic_driver").as_words(gray, video_bits).tobytes()
    if video_bits in (24, 48):
        # A converter in the block design drops the upper bytes.
        sent = np.frombuffer(sent, np.uint8).reshape(-1, video_bits // 6)[:, : video_bits // 8].tobytes()
    beats = height * -(-width // pixels_per_clock(video_bits))
    assert admitted(video_bits, [sent, sent], (width, height)) == [(0, beats)] * 2
