"""Frame admission: pixels of good frames get their positions, and bad frames are reported with their causes."""

import random

import pytest

from golden_model.records import Cause
from hdl.frame_admission import FrameAdmission
from sim.block_bench import BlockBench
from sim.recording import NO_PAUSES, Pauses

WIDTH_PX, HEIGHT_PX = 5, 4
GAPS_AND_HOLDS = Pauses(gaps=90, stalls=60, seed=3)


def frame(seed, *, drop=(), double=(), without_start=False):
    """Pixels ``(data, first, last)`` of a frame of random colours, some of them dropped or doubled."""
    colours = random.Random(seed)
    pixels = []
    for n in range(WIDTH_PX * HEIGHT_PX):
        pixel = (colours.getrandbits(24), int(n == 0 and not without_start), int(n % WIDTH_PX == WIDTH_PX - 1))
        pixels += [pixel] * ((n not in drop) + (n in double))
    return pixels


def admit(pixels, pauses=NO_PAUSES):
    """Frames ``(causes, [(x, y, data), ...])`` that come out; ``pauses.stalls`` hold the admission of pixels."""
    dut = FrameAdmission()
    frames, beats = [], []

    async def testbench(ctx):
        ctx.set(dut.i_width_px, WIDTH_PX)
        ctx.set(dut.i_height_px, HEIGHT_PX)
        ctx.set(dut.i_may_start, 1)
        waiting, cycle, last_taken = list(pixels), 0, 0
        await ctx.tick().repeat(2)
        while waiting or cycle < last_taken + 2 * WIDTH_PX * HEIGHT_PX:
            offered = bool(waiting) and not pauses.gap(cycle)
            held = pauses.stall(cycle, 1)
            ctx.set(dut.i.valid, offered)
            ctx.set(dut.i_hold, held)
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
                frames.append((Cause(causes), beats.copy()))
                beats.clear()
            cycle += 1

    BlockBench(dut, cycle_limit=2000).run(testbench)
    return frames


def good(pixels):
    return Cause(0), [(n % WIDTH_PX, n // WIDTH_PX, data) for n, (data, _, _) in enumerate(pixels)]


@pytest.mark.parametrize("pauses", [NO_PAUSES, GAPS_AND_HOLDS], ids=["back_to_back", "gaps_and_holds"])
def test_good_frames_get_their_positions(pauses):
    first, second = frame(1), frame(2)
    assert admit(first + second, pauses) == [good(first), good(second)]


@pytest.mark.parametrize("pauses", [NO_PAUSES, GAPS_AND_HOLDS], ids=["back_to_back", "gaps_and_holds"])
@pytest.mark.parametrize(
    ("bad", "cause"),
    [
        (frame(3, drop={7}), Cause.SHORT_LINE),
        (frame(3, drop={0}, without_start=True), Cause.MISSING_START),
        (frame(3, double={7}), Cause.LONG_LINE),
        (frame(3, drop={9}), Cause.LONG_LINE),
        (frame(3, drop=range(10, 20)), Cause.EARLY_END),
        (frame(3, drop=range(12, 20)), Cause.EARLY_END),
        (frame(3, drop=range(1, 20)), Cause.EARLY_END),
        (frame(3, without_start=True), Cause.MISSING_START),
        (frame(3) + frame(4, without_start=True), Cause.MISSING_START),
    ],
)
def test_a_bad_frame_is_reported_once_and_the_next_one_is_clean(bad, cause, pauses):
    before, after = frame(1), frame(2)
    frames = admit(before + bad + after, pauses)
    assert frames[0] == good(before)
    assert frames[-1] == good(after)
    assert [causes for causes, _ in frames[1:-1]][-1:] == [cause]
    for causes, beats in frames[1:-1]:
        whole = [] if causes == Cause.MISSING_START else [position for *position, _ in good(after)[1]]
        assert [position for *position, _ in beats] == whole


def test_an_early_end_is_filled_with_black():
    bad = frame(3, drop=range(10, 20))
    (_, beats), _ = admit(bad + frame(2))
    assert [data for *_, data in beats] == [data for data, _, _ in bad] + [0] * 10
