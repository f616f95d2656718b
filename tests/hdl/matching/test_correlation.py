# amaranth: UnusedElaboratable=no
"""Window correlation and fuzzy correlation equal the golden model, on random windows and on those of real matches."""

import dataclasses
import functools
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import PRESETS
from golden_model.front_end import extract
from golden_model.matching import correlation, rule_bases
from golden_model.matching.hamming import distances, mutual_matches
from hdl.matching.correlation import PIXELS, WindowCorrelation
from hdl.matching.fuzzy import Sugeno
from hdl.matching.fuzzy_correlation import FuzzyCorrelation, scale_constants
from sim.scene import make_pair
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.drivers import run_streams

PAUSES = Pauses(gaps=100, stalls=180, seed=4)


def windows() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Pairs of windows: random, similar, the extremes of every score, flat, black, single pixels."""
    rng = np.random.default_rng(5)
    any_pair = rng.integers(0, 256, (2, 40, PIXELS))
    near = rng.integers(0, 256, (40, PIXELS))
    alike = np.stack([near, (near + rng.integers(-9, 10, near.shape)).clip(0, 255)])
    gain = np.stack([near, near // 2])
    flat = np.repeat(rng.integers(0, 256, (2, 8, 1)), PIXELS, axis=2)
    dots = np.eye(PIXELS, dtype=int)[:, [0, 4, 8, 4]].T * rng.integers(1, 256, (2, 4, 1))
    half = np.arange(PIXELS) % 2 * 255
    black, white = np.zeros(PIXELS, int), np.full(PIXELS, 255)
    extremes = np.array([[half, black, black, white, white, half], [255 - half, black, white, black, white, half]])
    pairs = np.concatenate([any_pair, alike, gain, flat, dots, extremes], axis=1).astype(np.uint8)
    return pairs[0], pairs[1]


def graded_windows() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Pairs of decreasing similarity whose scores cover the rules' sets: bright ones and, for NCC, dark ones."""
    rng = np.random.default_rng(6)
    spread = np.linspace(0, 24, 60)[:, np.newaxis]
    bright = rng.integers(60, 200, (60, PIXELS))
    offset = rng.integers(-12, 13, (60, 1)) * rng.integers(0, 2, (60, 1))
    bright = np.stack([bright, bright + rng.normal(size=bright.shape) * spread + offset])
    shared, own = rng.integers(0, 24, (60, PIXELS)), rng.integers(0, 24, (2, 60, PIXELS))
    dark = shared * rng.integers(0, 2, shared.shape) + own * (rng.integers(0, 3, own.shape) == 0)
    left, right = np.concatenate([bright, dark], axis=1).clip(0, 255).astype(np.uint8)
    return left, right


@functools.cache
def matched() -> Any:
    """The left and the right feature of every mutual match between two rendered views."""
    config = dataclasses.replace(PRESETS["thesis"].front_end, threshold=60_000)
    left, right = (extract(image, config).features for image in make_pair(seed=3).images)
    distance = distances(left["descriptor"], right["descriptor"])
    at_left, at_right, _, _ = mutual_matches(distance, config.pattern.bits)
    return left[at_left], right[at_right]


def golden_scores(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.int64]:
    return np.stack([score(left, right) for score in (correlation.sad, correlation.zssd, correlation.ncc)], axis=1)


def payloads(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> list[dict[str, list[int]]]:
    return [{"left": a, "right": b} for a, b in zip(left.tolist(), right.tolist(), strict=True)]


@pytest.mark.parametrize("pauses", [NO_PAUSES, PAUSES], ids=["free", "pauses"])
def test_scores_equal_the_golden_model(pauses: Pauses) -> None:
    left, right = windows()
    expected = golden_scores(left, right)
    assert expected.min(axis=0).tolist() == [0, 0, 0]
    assert expected.max(axis=0).tolist() == [9 * 255, 81 * 255**2 - 255**2, 256]
    dut = WindowCorrelation()
    limit = 4 * len(left) * dut.latency_cycles
    received = run_streams(dut, {"i": payloads(left, right)}, {"o": len(left)}, pauses=pauses, cycle_limit=limit)["o"]
    np.testing.assert_array_equal([(scores.sad, scores.zssd, scores.ncc) for scores in received], expected)


@pytest.mark.parametrize("block", [WindowCorrelation, FuzzyCorrelation])
def test_a_result_takes_exactly_the_latency(block: type[WindowCorrelation] | type[FuzzyCorrelation]) -> None:
    dut = block()

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


def golden_weights(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Weight and rule of each pair of windows."""
    return np.stack(rule_bases.correlation().evaluate(*correlation.fuzzy_inputs(left, right)), axis=1)


def weighed(left: NDArray[np.uint8], right: NDArray[np.uint8], pauses: Pauses = NO_PAUSES) -> list[tuple[int, int]]:
    dut = FuzzyCorrelation()
    limit = 4 * len(left) * dut.latency_cycles
    received = run_streams(dut, {"i": payloads(left, right)}, {"o": len(left)}, pauses=pauses, cycle_limit=limit)["o"]
    return [(result.weight, result.rule) for result in received]


@pytest.mark.parametrize("pauses", [NO_PAUSES, PAUSES], ids=["free", "pauses"])
def test_fuzzy_correlation_equals_the_golden_model(pauses: Pauses) -> None:
    left, right = graded_windows()
    expected = golden_weights(left, right)
    assert len(set(expected[:, 1])) >= 10
    assert {0, 128, 255} < set(expected[:, 0])
    np.testing.assert_array_equal(weighed(left, right, pauses), expected)


def test_fuzzy_correlation_of_matched_corners() -> None:
    """On the windows of the mutual matches of two views, true and false matches."""
    left, right = matched()
    left, right = left["window"][::3], right["window"][::3]
    expected = golden_weights(left, right)
    assert len(left) > 80
    assert len(set(expected[:, 0])) > 10
    np.testing.assert_array_equal(weighed(left, right), expected)


@pytest.mark.parametrize(("variable", "factor"), [(0, Fraction(16, 9)), (1, Fraction(4, 81))], ids=["sad", "zssd"])
def test_scaling_is_exact_up_to_where_the_tables_end(variable: int, factor: Fraction) -> None:
    """Check every score with the constants by which the hardware multiplies."""
    limit, multiplier, shift = scale_constants(factor)
    scores = np.arange(limit)
    scaled = scores * multiplier >> shift
    np.testing.assert_array_equal(scaled, scores * factor.numerator // factor.denominator)
    assert rule_bases.correlation().inputs[variable].entries - 1 <= scaled[-1] <= 255


def test_fuzzy_ilbp_of_matched_corners() -> None:
    """On distance and SAD of the same matches, the inputs that the fuzzy stage gives the rules."""
    left, right = matched()
    bits = PRESETS["thesis"].front_end.pattern.bits
    distance = np.bitwise_count(left["descriptor"] ^ right["descriptor"]).sum(axis=1, dtype=np.int64)
    sad = correlation.sad(left["window"], right["window"])
    inputs = np.stack([distance, sad, sad], axis=1)[::2]
    system = rule_bases.ilbp(bits)
    expected = np.stack(system.evaluate(*inputs.T), axis=1)
    assert len(inputs) > 100
    assert len(set(expected[:, 0])) > 10
    dut = Sugeno(system=system, value_bits=12)
    results = run_streams(dut, {"i": inputs.tolist()}, {"o": len(inputs)}, cycle_limit=60 * len(inputs))["o"]
    np.testing.assert_array_equal([(result.weight, result.rule) for result in results], expected)
