"""Frames that are bad are reported with their cause and without matches, and do not change the frames around them.

The front end's tests have all causes (`tests.hdl.test_front_end`).
"""

from collections.abc import Sequence
from typing import Any

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles

from golden_model.arrays import Pixels
from golden_model.records import WORD_BYTES, Cause, Tag
from sim.backends.interface import FrameResult
from sim.simulators.accelerator_designs import FEATURES
from tests.cocotb.bench import Bench, assert_golden, make_lines, render_scene
from tests.cocotb.runner import CONFIG, MAX_SIZE_PX

SIZE_PX = (64, 64)
MISSING_LINES = 3
WAIT_CYCLES = 100
RECORD_WORDS = CONFIG.front_end.pattern.record.record_bytes // WORD_BYTES


def assert_bad(result: FrameResult, number: int, cause: Cause) -> None:
    """Check that both statuses of a frame give its cause, and that it has no matches."""
    for status in (result.status, result.match_status):
        assert not status["good"]
        assert status["causes"] == cause
        assert status["frame"] == number
        assert status["features"] == status["matches"] == status["kept"] == 0
    assert not len(result.matches)


async def _assert_counted(bench: Bench, results: Sequence[FrameResult], bad: int, cause: Cause) -> None:
    assert await bench.read("frames") == len(results)
    assert await bench.read("bad_frames") == bad
    assert await bench.read("causes") == cause
    assert await bench.read("frame_bad")


async def _assert_only_second_bad(
    bench: Bench, results: Sequence[FrameResult], good: tuple[Pixels, Pixels], cause: Cause
) -> None:
    assert_bad(results[1], 1, cause)
    assert_golden(results, {0: good[0], 2: good[1]})
    await _assert_counted(bench, results, 1, cause)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def a_transfer_that_ends_early(dut: Any) -> None:
    """In memory mode, the next transfer starts a new frame."""
    bench = await Bench.open(dut)
    left, right = render_scene(SIZE_PX, gray=True)
    await bench.configure(left, memory_mode=1)
    for image in (left, right[:-MISSING_LINES], right):
        await bench.send_memory(image)
    results = await bench.receive_frames(3)
    await _assert_only_second_bad(bench, results, (left, right), Cause.EARLY_END)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def more_features_than_fit(dut: Any) -> None:
    """Noise fills every cell, and the setting allows more features per cell than fit in total."""
    bench = await Bench.open(dut)
    left, right = render_scene(MAX_SIZE_PX, gray=True)
    noise = np.random.default_rng(0).integers(0, 256, left.shape, np.uint8)
    results = []
    for image, settings in ((left, {}), (noise, {"per_cell": 8}), (right, {})):
        await bench.configure(image, reference="held", memory_mode=1, **settings)
        await bench.send_memory(image)
        results += await bench.receive_frames(1)
    await _assert_only_second_bad(bench, results, (left, right), Cause.TOO_MANY_FEATURES)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def clear_in_mid_frame(dut: Any) -> None:
    """Clearing drops the frame in progress and the reference, ends a packet under way, and keeps the settings."""
    bench = await Bench.open(dut)
    bench.check_outputs()
    left, right = render_scene(SIZE_PX, gray=True)
    features = bench.sinks[FEATURES]
    await bench.configure(left)
    await bench.send_video(right)
    await bench.receive_frames(1)
    features.pause = True
    await bench.send(make_lines(right)[:-MISSING_LINES])
    while not await bench.read("features_waiting"):
        await ClockCycles(dut.aclk, WAIT_CYCLES)
    await bench.configure(left, clear=1)
    assert await bench.read("features_waiting")
    assert await bench.read("clearing")
    assert await bench.read("frames") == 0
    features.pause = False
    broken_off = await bench.receive_packet(FEATURES)
    assert not await bench.read("clearing")
    assert len(broken_off) % RECORD_WORDS == 0
    assert int(broken_off[-RECORD_WORDS]) == Tag.FRAME_STATUS | Cause.CLEARED << 16
    assert await bench.read("frames") == 0
    await bench.send_video(left, right)
    results = await bench.receive_frames(3)
    # The rest of the frame that was dropped: its start is gone.
    assert_bad(results[0], 0, Cause.MISSING_START)
    assert_golden(results, {1: left, 2: right})
    assert await bench.read("frames") == 3
