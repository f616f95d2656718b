# amaranth: UnusedElaboratable=no
"""Beats of every width of the video port, cut into pixels."""

from typing import Any

import pytest

from hdl.axi.video_input import VIDEO_BITS, VideoInput, pixels_per_clock
from sim.benches.block_bench import BlockBench

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


ONE_PIXEL = [bits for bits in VIDEO_BITS if pixels_per_clock(bits) == 1]


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
