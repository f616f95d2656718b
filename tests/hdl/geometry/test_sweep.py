"""What a sweep finds equals the golden model: score, support, list of inliers, and where they lie."""

from typing import Any

import numpy as np
import pytest

from golden_model.geometry.acceptance import INLIER_GAIN, count_cells
from golden_model.geometry.fixed_point import quantise
from golden_model.geometry.match_gain import gain
from golden_model.geometry.refit import BANDS, MAX_INLIERS
from hdl.geometry.match_gain import PAIR
from hdl.geometry.sweep import Sweep
from hdl.lib.line_memory import LineMemory
from tests.hdl.block_bench import BlockBench
from tests.hdl.geometry.match_cases import TRUTH, matches

SIZE = (641, 479)


@pytest.mark.parametrize(("count", "band"), [(61, BANDS[-1]), (1, BANDS[0]), (1100, BANDS[0])])
def test_a_sweep_equals_the_golden_model(count: int, band: int) -> None:
    """The second of two sweeps, so that nothing of the first is left; or one with more inliers than the list holds."""
    left, right, weight = matches(count)
    hypothesis = quantise(TRUTH[np.newaxis])
    gains = gain(hypothesis, left, right)[0]
    in_band = np.flatnonzero(gains >= band)[:MAX_INLIERS]
    assert count < MAX_INLIERS or len(in_band) == MAX_INLIERS
    dut = Sweep()
    listed: list[int] = []
    found: dict[str, int] = {}

    async def sweep(ctx: Any, order: np.ndarray) -> None:
        listed.clear()
        addresses = [0] * LineMemory.latency_cycles
        await bench.pulse(ctx, dut.i_start)
        while ctx.get(dut.o_busy):
            n = order[addresses.pop(0)]
            positions = dict(zip(PAIR.members, (*left[n].tolist(), *right[n].tolist()), strict=True))
            ctx.set(dut.i_match, {"pair": positions, "weight": int(weight[n])})
            if ctx.get(dut.o_list):
                listed.append(ctx.get(dut.o_listed_address))
            addresses.append(min(ctx.get(dut.o_address), len(order) - 1))
            await ctx.tick()

    async def run(ctx: Any) -> None:
        ctx.set(dut.i_hypothesis, hypothesis.ravel().tolist())
        order = np.arange(len(left))
        if count < MAX_INLIERS:
            await sweep(ctx, order[::-1])
        await sweep(ctx, order)
        for name in ("score", "support", "inliers", "cells", "listed"):
            found[name] = ctx.get(getattr(dut, f"o_{name}"))

    settings = {"i_count": len(left), "i_band": band, "i_size": SIZE[0] | SIZE[1] << 16}
    bench = BlockBench(dut, settings=settings, cycle_limit=2000)
    bench.run(run)
    inliers = gains >= INLIER_GAIN
    assert listed == in_band.tolist()
    assert found == {
        "score": gains @ weight,
        "support": weight[gains > 0].sum(),
        "inliers": inliers.sum(),
        "cells": count_cells(right[inliers], SIZE),
        "listed": len(in_band),
    }
