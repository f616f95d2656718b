"""Frames in either mode give the golden model's features and matches, however the streams pause."""

from __future__ import annotations

from typing import Any

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles

from golden_model.arrays import Pixels
from sim.backends.interface import Reference
from sim.cocotb.bench import Bench, assert_golden, golden, lines, scene, transfer
from sim.cocotb.runner import CONFIG, MAX_SIZE_PX
from sim.simulators.accelerator_designs import FEATURES, MATCHES
from sim.simulators.hardware import decode_frame

ODD_SIZE_PX = (125, 101)
LEAST_FEATURES, LEAST_MATCHES = 60, 15
QUIET_CYCLES = 500


async def _run(
    dut: Any, images: list[Pixels], *, memory_mode: bool, reference: Reference = "held", seed: int | None = None
) -> None:
    """Stream all frames without pauses, or with random ones on every channel; only their packets may come out."""
    bench = Bench(dut)
    await bench.start()
    if seed is not None:
        bench.pause_at_random(seed)
    await bench.configure(images[0], reference=reference, memory_mode=int(memory_mode))
    for packet in [transfer(images)] if memory_mode else [line for image in images for line in lines(image)]:
        await bench.video.send(packet)
    results = await bench.results(len(images))
    assert_golden(results, dict(enumerate(images)), reference)
    assert sum(len(frame.features) for frame in results) > LEAST_FEATURES
    assert sum(len(frame.matches) for frame in results) > LEAST_MATCHES

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
    left, right = scene(MAX_SIZE_PX, gray=False)
    await _run(dut, [left, right, left], memory_mode=False, reference="previous")


@cocotb.test(timeout_time=2, timeout_unit="ms")
async def gray_video_with_random_stalls(dut: Any) -> None:
    """Every channel pauses at random, those of the registers too."""
    await _run(dut, scene(MAX_SIZE_PX, gray=True), memory_mode=False, seed=100)


@cocotb.test(timeout_time=2, timeout_unit="ms")
async def gray_memory_of_an_odd_size_with_random_stalls(dut: Any) -> None:
    """Two frames in one transfer; the padding in the last beat of each is dropped."""
    await _run(dut, scene(ODD_SIZE_PX, gray=True), memory_mode=True, seed=200)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def colour_memory(dut: Any) -> None:
    """RGBX pixels; the X byte is ignored."""
    await _run(dut, scene(MAX_SIZE_PX, gray=False), memory_mode=True)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def an_output_that_is_off_discards(dut: Any) -> None:
    """A disabled output does not block the other one; outputs can be enabled and disabled between frames."""
    bench = Bench(dut)
    await bench.start()
    left, right = scene(MAX_SIZE_PX, gray=True)
    expected = golden({0: left, 1: right, 2: left}, "held")
    features, matches = (bench.sinks[name] for name in (FEATURES, MATCHES))
    features.pause = True
    await bench.configure(left, memory_mode=1, features_enable=0)
    await bench.video.send(transfer([left, right]))
    match_words = [await bench.packet(MATCHES) for _ in range(2)]
    assert await bench.read("frames") == 2
    assert not await bench.read("features_waiting")

    features.pause, matches.pause = False, True
    await bench.configure(left, memory_mode=1, matches_enable=0, matches_done=1)
    await bench.video.send(transfer([left]))
    feature_words = await bench.packet(FEATURES)
    while not await bench.read("matches_done"):
        await ClockCycles(dut.aclk, QUIET_CYCLES)
    assert await bench.read("last_matches") == len(expected[2].matches)
    assert not await bench.read("matches_waiting")
    assert features.empty()
    assert matches.empty()

    found = decode_frame(feature_words, match_words[1], CONFIG)
    assert np.array_equal(found.features, expected[2].features)
    assert np.array_equal(found.matches, expected[1].matches)
