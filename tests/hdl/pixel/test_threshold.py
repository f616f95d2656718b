# amaranth: UnusedElaboratable=no
"""The adaptive threshold changes exactly as in the golden model."""

import random
from typing import Any

import pytest

from golden_model.config import DETECTORS
from golden_model.pixel.threshold import STEPS, next_code
from hdl.pixel.threshold import AdaptiveThreshold
from tests.hdl.block_bench import BlockBench

MAX_FEATURES = 300


@pytest.mark.parametrize("detector", DETECTORS)
@pytest.mark.parametrize("start_code", [1, 200, 32_000])
def test_threshold_follows_the_golden_model(detector: str, start_code: int) -> None:
    dut = AdaptiveThreshold(max_features=MAX_FEATURES)
    start_code = min(start_code, STEPS[detector].max_code)
    rng = random.Random(start_code)
    frames = [(rng.choice([0, 5, 150, 299, 310]), rng.random() < 0.8) for _ in range(12)]
    bench = BlockBench(dut)
    codes = []

    async def testbench(ctx: Any) -> None:
        ctx.set(dut.i_detector, DETECTORS.index(detector))
        ctx.set(dut.i_target, 150)
        ctx.set(dut.i_code, start_code)
        await bench.pulse(ctx, dut.i_load)
        for features, adapt in frames:
            ctx.set(dut.i_adapt, adapt)
            left = features
            while left:
                added = min(rng.randint(0, 2), left)
                left -= added
                ctx.set(dut.i_added, added)
                await ctx.tick()
            ctx.set(dut.i_added, 0)
            await ctx.tick().repeat(dut.latency_cycles - 1)
            await bench.pulse(ctx, dut.i_frame_ends)
            codes.append(ctx.get(dut.o_code))

    bench.run(testbench)
    expected, code = [], start_code
    for features, adapt in frames:
        if adapt:
            code = next_code(code, min(features, MAX_FEATURES), 150, detector)
        expected.append(code)
    assert codes == expected
    assert len(set(codes)) > 2
