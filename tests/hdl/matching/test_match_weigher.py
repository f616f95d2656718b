# amaranth: UnusedElaboratable=no
"""Weights, rules and the common orientation of made-up pairs equal the golden matcher's."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import MatcherConfig
from golden_model.feature.ilbp import ILBP_128, PATTERNS, DescriptorPattern
from golden_model.matching.matcher import common_orientation, pair_features, weigh
from hdl.matching.feature_banks import READ_CYCLES
from hdl.matching.match_weigher import MatchWeigher
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench

COUNT = 24
PAUSES = Pauses(gaps=80, stalls=120, seed=2)


def pairs(pattern: DescriptorPattern) -> tuple[NDArray[np.void], NDArray[np.void], NDArray[np.void]]:
    """Features of both sides, and matches of each with its partner: near and far ones, most of them turned alike."""
    rng = np.random.default_rng(1)
    left, right = np.zeros((2, COUNT), pattern.record.dtype)
    if pattern.oriented:
        left["sector"] = rng.integers(0, 16, COUNT)
        right["sector"] = (left["sector"] + 13 + rng.choice([0, 0, 0, 1, 2, 8, 14, 15], COUNT)) % 16
    if pattern.carries_window:
        left["window"] = rng.integers(0, 256, (COUNT, 9))
        right["window"] = np.clip(left["window"] + rng.normal(0, rng.uniform(0, 30, (COUNT, 1)), (COUNT, 9)), 0, 255)
    index = np.arange(COUNT)
    matches = pair_features(left, right, index, index)
    matches["distance"] = rng.integers(0, pattern.bits // 2, COUNT)
    matches["margin"] = rng.integers(0, pattern.bits // 4, COUNT)
    if pattern.oriented:
        matches["turn"] = (right["sector"] - left["sector"]) % 16
        matches["peak_turn"] = common_orientation(matches["turn"], matches["distance"], matches["margin"], pattern.bits)
    return left, right, matches


@pytest.mark.parametrize(
    ("pattern", "rule_base", "pauses"),
    [
        (ILBP_128, "aerial", NO_PAUSES),
        (ILBP_128, "aerial", PAUSES),
        (ILBP_128, "none", PAUSES),
        (PATTERNS["thesis-ilbp-4"], "ilbp", PAUSES),
    ],
)
def test_weights_and_turns_equal_the_golden_model(pattern: DescriptorPattern, rule_base: str, pauses: Pauses) -> None:
    config = MatcherConfig(rule_base=rule_base)
    left, right, matches = pairs(pattern)
    expected = weigh(matches, left, right, pattern, config)
    dut = MatchWeigher(config=config, pattern=pattern, max_features=COUNT)
    bench = BlockBench(dut, pauses=pauses)
    found: list[tuple[int, ...]] = []

    async def banks(ctx: Any) -> None:
        """Show the features of the pair that waits, as late as the banks do, and others before."""
        asked = [0] * READ_CYCLES
        async for *_, pair in ctx.tick().sample(dut.i.payload):
            asked = [pair.left, *asked[:-1]]
            for port, features in ((dut.i_left, left), (dut.i_right, right)):
                feature = features[asked[-1] % COUNT]
                value = {"sector": int(feature["sector"]) if pattern.oriented else 0}
                if pattern.carries_window:
                    value["window"] = int.from_bytes(feature["window"].tobytes(), "little")
                ctx.set(port, value)

    async def send(ctx: Any) -> None:
        for each in matches.tolist():
            match = dict(zip(matches.dtype.names or (), each, strict=True))
            pair = {"left": match["left_index"], "right": match["right_index"]}
            await bench.stream_put(ctx, dut.i, pair | {name: match[name] for name in ("distance", "margin")})

    async def run(ctx: Any) -> None:
        # Wait until the bins of the histogram are cleared.
        await bench.wait_until_low(ctx, dut.o_busy, at_most=17)
        if pattern.oriented:
            ctx.set(dut.i_count, 1)
            await send(ctx)
            ctx.set(dut.i_count, 0)
            await bench.pulse(ctx, dut.i_find)
            await bench.wait_until_low(ctx, dut.o_busy, at_most=49)
        await send(ctx)

    async def take(ctx: Any) -> None:
        while len(found) < COUNT:
            result = await bench.stream_get(ctx, dut.o)
            found.append((result.weight, result.rule, result.turn, result.peak_turn))

    bench.run(run, take, background=[banks])
    assert found == [tuple(each) for each in expected[["weight", "rule", "turn", "peak_turn"]].tolist()]
    if rule_base != "none":
        assert len({weight for weight, *_ in found}) > 5
