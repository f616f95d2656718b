"""Frame admission: bad frames are reported with their causes.

`tests/formal` proves the rest, memory mode among it; `test_front_end` has two pixels per clock.
"""

import random
from collections.abc import Container
from typing import Any

import pytest

from golden_model.records import Cause
from hdl.frame_admission import FrameAdmission
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench

WIDTH_PX, HEIGHT_PX = 7, 6
CLOSING_LINES, CLOSING_PX = 2, 4
CLOSING_X, CLOSING_Y = 2, 4
GAPS_AND_HOLDS = Pauses(gaps=90, stalls=60, seed=3)


def frame(
    seed: int, *, drop: Container[int] = (), double: Container[int] = (), without_start: bool = False
) -> list[tuple[int, int, int]]:
    """Pixels ``(data, first, last)`` of a frame of random colours, some of them dropped or doubled."""
    colours = random.Random(seed)
    pixels = []
    for n in range(WIDTH_PX * HEIGHT_PX):
        pixel = (colours.getrandbits(24), int(n == 0 and not without_start), int(n % WIDTH_PX == WIDTH_PX - 1))
        pixels += [pixel] * ((n not in drop) + (n in double))
    return pixels


def transfer(seed: int, pixels: int = WIDTH_PX * HEIGHT_PX) -> list[tuple[int, int, int]]:
    """The first pixels of a frame in memory mode: only the last one is marked."""
    return [(data, 0, int(n == pixels - 1)) for n, (data, _, _) in enumerate(frame(seed)[:pixels])]


def admit(pixels: list[Any], pauses: Pauses = NO_PAUSES, **inputs: int) -> list[Any]:
    """Frames ``(causes, [(x, y, data), ...])`` that come out; ``pauses.stalls`` hold the admission of pixels.

    Between pixels, a dictionary changes inputs.
    """
    dut = FrameAdmission(closing_lines=CLOSING_LINES, closing_px=CLOSING_PX)
    frames, beats = [], []

    async def testbench(ctx: Any) -> None:
        ctx.set(dut.i_width_px, WIDTH_PX)
        ctx.set(dut.i_height_px, HEIGHT_PX)
        ctx.set(dut.i_may_start, 1)
        ctx.set(dut.i_acceptable, 1)
        for name, value in inputs.items():
            ctx.set(getattr(dut, name), value)
        waiting, cycle, last_taken = list(pixels), 0, 0
        await ctx.tick().repeat(2)
        while waiting or cycle < last_taken + 2 * WIDTH_PX * HEIGHT_PX:
            if waiting and isinstance(waiting[0], dict):
                ctx.set(dut.i.valid, 0)
                for name, value in waiting.pop(0).items():
                    ctx.set(getattr(dut, name), value)
                await ctx.tick().repeat(2)
                continue
            offered = bool(waiting) and not pauses.gap(cycle)
            is_held = pauses.stall(cycle, 1)
            ctx.set(dut.i.valid, offered)
            ctx.set(dut.i_hold, is_held)
            ctx.set(dut.i_may_end, not pauses.stall(cycle, 2))
            if offered:
                data, first, last = waiting[0]
                ctx.set(dut.i.payload, {"data": data, "first": first, "last": last})
            *_, ready, beat, ends, causes = await ctx.tick().sample(dut.i.ready, dut.o, dut.o_end, dut.o_causes)
            if offered and ready:
                waiting.pop(0)
                last_taken = cycle
            if beat.valid:
                beats.append((beat.x, beat.y, beat.data))
            if ends:
                assert not pauses.stall(cycle - 2, 2), "a frame ended before it might"
                frames.append((Cause(causes), beats.copy()))
                beats.clear()
            cycle += 1

    BlockBench(dut, cycle_limit=4000).run(testbench)
    return frames


def good(pixels: list[tuple[int, int, int]]) -> tuple[Cause, list[tuple[int, int, int]]]:
    return Cause(0), [(n % WIDTH_PX, n // WIDTH_PX, data) for n, (data, _, _) in enumerate(pixels)]


def early_end(pixels: list[tuple[int, int, int]]) -> tuple[Cause, list[tuple[int, int, int]]]:
    """A frame of which only ``pixels`` came: black completes the line, and the ends of the last lines."""
    missing = -len(pixels) % WIDTH_PX
    lines = (len(pixels) + missing) // WIDTH_PX
    beats = good(pixels + [(0, 0, 0)] * missing)[1]
    rest = [(x, y, 0) for y in range(max(lines, CLOSING_Y), HEIGHT_PX) for x in range(CLOSING_X, WIDTH_PX)]
    return Cause.EARLY_END, beats + rest


MISSED: tuple[Cause, list[Any]] = (Cause.MISSING_START, [])


@pytest.mark.parametrize(
    ("bad", "cause", "pauses"),
    [
        (frame(3, drop={9}), Cause.SHORT_LINE, NO_PAUSES),
        (frame(3, drop={9}), Cause.SHORT_LINE, GAPS_AND_HOLDS),
        (frame(3, double={9}), Cause.LONG_LINE, NO_PAUSES),
        (frame(3, drop={13}), Cause.LONG_LINE, GAPS_AND_HOLDS),
        (frame(3, drop=range(16, 42)), Cause.EARLY_END, NO_PAUSES),
        (frame(3, drop=range(39, 42)), Cause.EARLY_END, GAPS_AND_HOLDS),
        (frame(3, drop=range(1, 42)), Cause.EARLY_END, NO_PAUSES),
        (frame(3, without_start=True), Cause.MISSING_START, GAPS_AND_HOLDS),
        (frame(3, drop={0}, without_start=True), Cause.MISSING_START, NO_PAUSES),
    ],
)
def test_a_bad_frame_is_reported_once_and_the_next_one_is_clean(
    bad: list[tuple[int, int, int]], cause: Cause, pauses: Pauses
) -> None:
    before, after = frame(1), frame(2)
    first, (reported, beats), last = admit(before + bad + after, pauses)
    assert (first, reported, last) == (good(before), cause, good(after))
    if cause == Cause.EARLY_END:
        assert beats == early_end(bad)[1]
    else:
        assert [position for *position, _ in beats] == (
            [] if cause == Cause.MISSING_START else [position for *position, _ in good(after)[1]]
        )


@pytest.mark.parametrize("pauses", [NO_PAUSES, GAPS_AND_HOLDS], ids=["back_to_back", "gaps_and_holds"])
@pytest.mark.parametrize("before", [frame(1), frame(1, double={9}), frame(1, drop={9})], ids=["good", "long", "short"])
def test_each_frame_without_start_is_reported_whatever_came_before(
    before: list[tuple[int, int, int]], pauses: Pauses
) -> None:
    """After a bad frame the pixels of the next ones could be its own, which must not hide them."""
    frames = admit(before + 3 * frame(2, without_start=True) + frame(3), pauses)
    assert frames[1:] == [MISSED, MISSED, MISSED, good(frame(3))]


@pytest.mark.parametrize("at", [1, 10, 14, 40])
def test_a_spurious_start_costs_a_line_and_the_closing_lines_at_most(at: int) -> None:
    spoilt = frame(1)
    spoilt[at] = (spoilt[at][0], 1, spoilt[at][2])
    first, second, last = admit(spoilt + frame(2))
    assert (first[0], last) == (Cause.EARLY_END, good(frame(2)))
    # The rest of the frame counts its lines from the spurious start, so that most of them seem to be too short.
    assert second[0] in (Cause.EARLY_END, Cause.SHORT_LINE)
    for (_, beats), pixels in ((first, spoilt[:at]), (second, spoilt[at:])):
        assert len(beats) - len(pixels) <= WIDTH_PX + CLOSING_LINES * (WIDTH_PX - CLOSING_X)


@pytest.mark.parametrize("pauses", [NO_PAUSES, GAPS_AND_HOLDS], ids=["back_to_back", "gaps_and_holds"])
def test_frames_with_impossible_settings_are_refused(pauses: Pauses) -> None:
    refused: tuple[Cause, list[Any]] = (Cause.INVALID_SETTINGS, [])
    video = frame(1) + frame(2)
    assert admit(video, pauses, i_acceptable=0) == [refused, refused]
    assert admit(transfer(1) + transfer(2), pauses, i_acceptable=0, i_memory_mode=1) == [refused, refused]
    # Of a size that is impossible, no lines can be counted.
    assert admit(frame(1) + 2 * frame(2, without_start=True) + frame(3), pauses, i_acceptable=0) == [refused, refused]


def test_a_refused_transfer_that_breaks_off_is_forgotten_in_video_mode() -> None:
    broken, repaired = transfer(1)[:3], {"i_memory_mode": 1, "i_acceptable": 1}
    pixels = [*broken, {"i_memory_mode": 0}, repaired, *transfer(2)]
    found = admit(pixels, i_acceptable=0, i_memory_mode=1)
    assert found == [(Cause.INVALID_SETTINGS, []), good(transfer(2))]
