# amaranth: UnusedElaboratable=no
"""Beats of every width of the video port, cut into pixels."""

from typing import Any

import numpy as np
import pytest
from amaranth import Cat, Module
from amaranth.lib import wiring
from amaranth.sim import Simulator

from hdl.axi.video_input import VideoInput
from hdl.build import VIDEO_BITS, Build, pixels_per_clock
from hdl.frame_admission import FrameAdmission
from sim.benches.exported import host_programs
from tests.hdl.block_bench import CLOCK_S, BlockBench

PIXELS = [0x11, 0x22, 0x33, 0x44, 0x55, 0x66]


def received(video_bits: int, beats: list[int], *, memory_mode: int, gray: int) -> list[Any]:
    """The pixels' data that come of ``beats``."""
    dut = VideoInput(video_bits=video_bits)
    bench = BlockBench(dut, settings={"i_memory_mode": memory_mode, "i_gray_input": gray})
    pixels = []

    async def send(ctx: Any) -> None:
        for beat in beats:
            await bench.stream_put(ctx, dut.i, {"data": beat, "first": 0, "last": 0})

    async def receive(ctx: Any) -> None:
        for _ in PIXELS:
            pixels.append((await bench.stream_get(ctx, dut.o)).data)

    bench.run(receive, background=[send])
    return pixels


ONE_PIXEL = [bits for bits in VIDEO_BITS["streams"] if pixels_per_clock(bits) == 1]


@pytest.mark.parametrize("video_bits", ONE_PIXEL)
def test_gray_from_memory(video_bits: int) -> None:
    beats = [0x44332211, 0xEEEE6655] if video_bits == 32 else PIXELS
    found = received(video_bits, beats, memory_mode=1, gray=1)
    assert [pixel & 0xFF for pixel in found] == PIXELS


@pytest.mark.parametrize("video_bits", [32, 24])
def test_colour_from_memory_comes_in_the_order_of_video(video_bits: int) -> None:
    red_green_blue = [0x0000_01 * pixel + 0xAA00 + 0xBB0000 for pixel in PIXELS]
    found = received(video_bits, red_green_blue, memory_mode=1, gray=0)
    assert found == [0xAA + 0xBB00 + (pixel << 16) for pixel in PIXELS]


@pytest.mark.parametrize("video_bits", ONE_PIXEL)
def test_video_passes_unchanged(video_bits: int) -> None:
    assert received(video_bits, PIXELS, memory_mode=0, gray=1) == PIXELS


@pytest.mark.parametrize("video_bits", [48, 16])
@pytest.mark.parametrize("memory_mode", [0, 1])
def test_two_gray_pixels_a_clock(video_bits: int, memory_mode: int) -> None:
    beats = [left | right << video_bits // 2 for left, right in zip(PIXELS, reversed(PIXELS), strict=True)]
    found = received(video_bits, beats, memory_mode=memory_mode, gray=1)
    assert [[pixel & 0xFF for pixel in pair] for pair in found] == list(
        map(list, zip(PIXELS, PIXELS[::-1], strict=True))
    )


@pytest.mark.parametrize(("memory_mode", "colour"), [(0, 0xBBAA00), (1, 0x00BBAA)])
def test_two_coloured_pixels_a_clock(memory_mode: int, colour: int) -> None:
    beats = [0xBBAA00 + pixel + (0xBBAA00 + pixel + 1 << 24) for pixel in PIXELS]
    found = received(48, beats, memory_mode=memory_mode, gray=0)
    shift = 16 * memory_mode
    assert [list(pair) for pair in found] == [[colour + (p << shift), colour + (p + 1 << shift)] for p in PIXELS]


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
