"""Frames in either mode give the golden model's features and matches, however the streams pause."""

from typing import Any

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles

from golden_model.arrays import Pixels
from sim.backends.interface import Reference
from tests.cocotb.bench import Bench, assert_golden, render_scene
from tests.cocotb.runner import MAX_SIZE_PX

ODD_SIZE_PX = (83, 67)
SMALL_PX = (64, 64)
MIN_FEATURES, MIN_MATCHES = 40, 8
QUIET_CYCLES = 500


async def _run(
    dut: Any, images: list[Pixels], *, memory_mode: bool, reference: Reference = "held", seed: int | None = None
) -> None:
    """Stream all frames without pauses, or with random ones on every channel; only their packets may come out."""
    bench = await Bench.open(dut)
    if seed is not None:
        bench.pause_at_random(seed)
    await bench.configure(images[0], reference=reference, memory_mode=int(memory_mode))
    await (bench.send_memory if memory_mode else bench.send_video)(*images)
    results = await bench.receive_frames(len(images))
    assert_golden(results, dict(enumerate(images)), reference)
    assert sum(len(frame.features) for frame in results) > MIN_FEATURES
    assert sum(len(frame.matches) for frame in results) > MIN_MATCHES

    last = results[-1]
    assert await bench.read("frames") == len(images)
    assert await bench.read("bad_frames") == 0
    assert await bench.read("last_features") == len(last.features)
    assert await bench.read("last_matches") == len(last.matches)
    assert await bench.read("last_kept") == np.count_nonzero(last.matches["verdict"])
    await ClockCycles(dut.aclk, QUIET_CYCLES)
    assert all(sink.empty() and sink.idle() for sink in bench.sinks.values())


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def colour_video_back_to_back(dut: Any) -> None:
    """Video mode, with TUSER and TLAST; each frame is matched with the one before it."""
    await _run(dut, render_scene(MAX_SIZE_PX, gray=False), memory_mode=False, reference="previous")


@cocotb.test(timeout_time=2, timeout_unit="ms")
async def gray_video_of_an_odd_size_with_random_stalls(dut: Any) -> None:
    """Every channel pauses at random, and no cell divides the sizes of lines and frames."""
    await _run(dut, render_scene(ODD_SIZE_PX, gray=True), memory_mode=False, seed=300)


@cocotb.test(timeout_time=2, timeout_unit="ms")
async def gray_memory_of_an_odd_size_with_random_stalls(dut: Any) -> None:
    """Two frames in one transfer; the padding in the last beat of each is dropped."""
    await _run(dut, render_scene(ODD_SIZE_PX, gray=True), memory_mode=True, seed=200)
