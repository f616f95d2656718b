"""Frames of matches, their estimates in Amaranth's simulator, and those of the golden model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from golden_model.config import EstimatorConfig
from golden_model.geometry import estimator as golden
from golden_model.geometry.estimator import Estimate, FrameMatches
from hdl.geometry.estimator import HomographyEstimator
from hdl.geometry.match_gain import PAIR
from hdl.geometry.ordering import FRAME
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.geometry.match_cases import TRUTH

MAX_MATCHES = 29

NUMBERS = ("score", "support", "inliers", "cells", "causes", "cycles")
Given = tuple[FrameMatches, EstimatorConfig]


def frame(count: int, seed: int) -> Given:
    """Matches near `TRUTH`, and wrong ones."""
    rng, size = np.random.default_rng(seed), np.array((320, 241))
    left = rng.integers(500, 16 * size - 500, (count, 2))
    mapped = np.column_stack((left / 16, np.ones(count))) @ TRUTH.T
    right = np.rint(16 * (mapped[:, :2] / mapped[:, 2:] + rng.normal(0, 0.4, left.shape))).astype(np.int64).clip(0)
    is_wrong = rng.random(count) < 0.3
    right[is_wrong] = rng.integers(0, 16 * size, (is_wrong.sum(), 2))
    matches = FrameMatches(left, right, rng.integers(1, 256, count), (320, 241))
    return matches, EstimatorConfig(passes=1, seed=seed)


def assert_equal(results: list[Estimate], frames: list[Given]) -> None:
    for number, (result, given) in enumerate(zip(results, frames, strict=True)):
        expected = golden.estimate(*given, max_matches=MAX_MATCHES)
        np.testing.assert_array_equal(result.homography, expected.homography, err_msg=f"frame {number}")
        for name in NUMBERS:
            assert getattr(result, name) == getattr(expected, name), f"frame {number}: {name}"


def simulate_estimates(
    frames: Sequence[Given], *, max_matches: int, pauses: Pauses = NO_PAUSES, cycle_limit: int = 1_000_000
) -> list[Estimate]:
    """Send frames of matches, with the settings for each; the next frame does not wait for a result.

    It simulates about a thousand clocks per second.
    """
    dut = HomographyEstimator(max_matches=max_matches)
    bench = BlockBench(dut, pauses=pauses, cycle_limit=cycle_limit)
    received: list[Estimate] = []

    async def send(ctx: Any) -> None:
        for number, (frame, settings) in enumerate(frames):
            *matches, end = match_payloads(frame, number)
            for payload in matches:
                await bench.stream_put(ctx, dut.i, payload)
            # Those of the frame before have been taken when its successor's end is the next.
            while number > len(received):
                await ctx.tick()
            ctx.set(dut.i_settings, vars(settings))
            await bench.stream_put(ctx, dut.i, end)

    async def receive(ctx: Any) -> None:
        for number in range(len(frames)):
            payload = await bench.stream_get(ctx, dut.o)
            assert payload.frame == number
            elements = np.array([payload.homography[n] for n in range(9)]).reshape(3, 3)
            received.append(Estimate(elements, *(int(getattr(payload, name)) for name in NUMBERS)))

    bench.run(send, receive)
    return received


def match_payloads(frame: FrameMatches, number: int = 0) -> list[dict[str, Any]]:
    """Payloads of ``i`` for a frame: its matches, and their end."""
    rows = np.hstack((frame.left, frame.right, frame.weight[:, np.newaxis])).tolist()
    matches = [{"pair": dict(zip(PAIR.members, row, strict=False)), "weight": row[-1]} for row in rows]
    nothing = {"pair": dict.fromkeys(PAIR.members, 0), "weight": 0}
    end = {"frame": number, "width": frame.size[0], "height": frame.size[1], "good": int(frame.good)}
    sent = [{"match": match, "ends": 0, "frame": dict.fromkeys(FRAME.members, 0)} for match in matches]
    return [*sent, {"match": nothing, "ends": 1, "frame": end}]
