"""Estimates homographies in Amaranth's simulator, with the signature of `golden_model.geometry.estimator.estimate`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from golden_model.config import EstimatorConfig
from golden_model.geometry.estimator import Estimate, FrameMatches
from golden_model.geometry.scoring import MAX_MATCHES
from hdl.geometry.estimator import HomographyEstimator
from hdl.geometry.match_gain import PAIR
from hdl.geometry.ordering import FRAME
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench


def simulate_estimates(
    frames: Sequence[tuple[FrameMatches, EstimatorConfig]],
    *,
    max_matches: int = MAX_MATCHES,
    pauses: Pauses = NO_PAUSES,
    cycle_limit: int = 1_000_000,
) -> list[Estimate]:
    """Send frames of matches, with the settings for each, through `hdl.geometry.estimator.HomographyEstimator`.

    The next frame does not wait for a result. It simulates about a thousand clocks per second.

    Raises
    ------
    AssertionError
        If the block breaks the stream rules, or takes more clocks than ``cycle_limit``.
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
            names = ("score", "support", "inliers", "cells", "causes", "cycles")
            received.append(Estimate(elements, *(int(getattr(payload, name)) for name in names)))

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
