# amaranth: UnusedElaboratable=no
"""Beats of every width of the video port, cut into pixels."""

from itertools import product
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


@pytest.mark.parametrize(
    ("video_bits", "memory_mode", "gray"),
    [each for each in product(VIDEO_BITS["streams"], (0, 1), (0, 1)) if each[0] > 16 or each[2]],
)
def test_beats_become_pixels(video_bits: int, memory_mode: int, gray: int) -> None:
    """Four gray pixels from memory in a beat of 32 bits; two of any kind in one of 48 or 16, the left one lowest."""
    pair_bits = video_bits // 2 if pixels_per_clock(video_bits) == 2 else 0
    bits = pair_bits or video_bits
    colours = PIXELS if gray else [0xBBAA00 + pixel for pixel in PIXELS]
    beats = [left | right << pair_bits for left, right in zip(colours, colours[::-1], strict=True)] if pair_bits else (
        [0x44332211, 0xEEEE6655] if memory_mode and gray and bits == 32 else colours
    )  # fmt: skip
    # Memory has red, green, blue; video green, blue, red.
    wanted = [0x00BBAA + (pixel << 16) for pixel in PIXELS] if memory_mode and not gray else colours
    found = received(video_bits, beats, memory_mode=memory_mode, gray=gray)
    mask = 0xFF if gray else 0xFFFFFF
    both = [[left, right] for left, right in zip(wanted, wanted[::-1], strict=True)]
    assert [[each & mask for each in pixels] for pixels in found] == (
        both if pair_bits else [[each] for each in wanted]
    )


def received(video_bits: int, beats: list[int], *, memory_mode: int, gray: int) -> list[list[int]]:
    """The data of the pixels of each clock that come of ``beats``."""
    dut = VideoInput(video_bits=video_bits)
    bench = BlockBench(dut, settings={"i_memory_mode": memory_mode, "i_gray_input": gray})
    pixels = []

    async def send(ctx: Any) -> None:
        for beat in beats:
            await bench.stream_put(ctx, dut.i, {"data": beat, "first": 0, "last": 0})

    async def receive(ctx: Any) -> None:
        for _ in PIXELS:
            data = (await bench.stream_get(ctx, dut.o)).data
            pixels.append([data] if dut.pixels_per_clock == 1 else list(data))

    bench.run(receive, background=[send])
    return pixels


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
