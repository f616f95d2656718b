"""Windows of matched corners of two rendered views, and what several tests do with blocks that take windows."""

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.config import PRESETS
from golden_model.front_end import extract
from golden_model.matching.hamming import distances, mutual_matches
from sim.scene import make_pair
from tests.hdl.block_bench import BlockBench


@functools.cache
def matched() -> Any:
    """The left and the right feature of every mutual match between two rendered views."""
    config = dataclasses.replace(PRESETS["thesis"].front_end, threshold=60_000)
    left, right = (extract(image, config).features for image in make_pair(seed=3).images)
    distance = distances(left["descriptor"], right["descriptor"])
    at_left, at_right, _, _ = mutual_matches(distance, config.pattern.bits)
    return left[at_left], right[at_right]


def payloads(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> list[dict[str, list[int]]]:
    return [{"left": a, "right": b} for a, b in zip(left.tolist(), right.tolist(), strict=True)]


def check_latency(dut: Any) -> None:
    """A result takes exactly the latency, and the next one as long after it was taken."""

    async def run(ctx: Any) -> None:
        ctx.set(dut.i.valid, 1)
        for _ in range(2):
            ctx.set(dut.o.ready, 0)
            await ctx.tick().repeat(dut.latency_cycles - 1)
            assert not ctx.get(dut.o.valid)
            await ctx.tick()
            assert ctx.get(dut.o.valid)
            ctx.set(dut.o.ready, 1)
            await ctx.tick().until(dut.i.ready)

    BlockBench(dut, cycle_limit=4 * dut.latency_cycles).run(run)
