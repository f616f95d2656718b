"""The peak of the histogram of relative orientations equals the golden model."""

from typing import Any

import numpy as np

from golden_model.feature.orientation import SECTORS
from golden_model.matching import rule_bases
from golden_model.matching.matcher import common_orientation
from hdl.matching.orientation_histogram import OrientationHistogram
from tests.hdl.block_bench import BlockBench


def test_peak_of_the_orientation_histogram_equals_the_golden_model() -> None:
    bits, rng = 128, np.random.default_rng(4)
    system = rule_bases.aerial_orientation(bits)
    frames = []
    for count in (60, 0, 25, 1, 40, 3):
        distance, margin = rng.integers(0, 30, count), rng.integers(0, 20, count)
        turn = rng.integers(0, 16, count) if count % 2 else (rng.normal(count, 1.5, count) % SECTORS).astype(np.int64)
        frames.append((turn.astype(np.uint8), distance.astype(np.uint16), margin.astype(np.uint16)))
    # Two equal maxima: the first one wins.
    frames.append((np.array([12, 5, 3], np.uint8), np.zeros(3, np.uint16), np.full(3, 18, np.uint16)))

    dut = OrientationHistogram(max_matches=64)
    bench = BlockBench(dut)
    peaks = []

    async def run(ctx: Any) -> None:
        for turns, distance, margin in frames:
            weights, _ = system.evaluate(distance, margin)
            for turn, weight in zip(turns.tolist(), weights.tolist(), strict=True):
                await bench.stream_put(ctx, dut.i, {"relative_orientation": turn, "weight": weight})
            await bench.pulse(ctx, dut.i_find)
            await bench.wait_until_low(ctx, dut.o_busy, at_most=49)
            peaks.append(ctx.get(dut.o_peak))

    bench.run(run)
    assert peaks == [common_orientation(turn, distance, margin, bits) for turn, distance, margin in frames]
    assert len(set(peaks)) > 3
