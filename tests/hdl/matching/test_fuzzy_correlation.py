# amaranth: UnusedElaboratable=no
"""Fuzzy correlation equals the golden model, on graded windows."""

from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.matching import correlation, rule_bases
from hdl.matching.correlation import PIXELS
from hdl.matching.fuzzy_correlation import FuzzyCorrelation, scale_constants
from sim.simulators.recording import Pauses
from tests.hdl.drivers import run_streams
from tests.hdl.matching.windows import check_latency, payloads


def graded_windows() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Pairs of decreasing similarity whose scores cover the rules' sets: bright ones and, for NCC, dark ones."""
    rng = np.random.default_rng(5)
    spread = np.linspace(0, 24, 40)[:, np.newaxis]
    bright = rng.integers(60, 200, (40, PIXELS))
    offset = rng.integers(-12, 13, (40, 1)) * rng.integers(0, 2, (40, 1))
    bright = np.stack([bright, bright + rng.normal(size=bright.shape) * spread + offset])
    shared, own = rng.integers(0, 24, (40, PIXELS)), rng.integers(0, 24, (2, 40, PIXELS))
    dark = shared * rng.integers(0, 2, shared.shape) + own * (rng.integers(0, 3, own.shape) == 0)
    left, right = np.concatenate([bright, dark], axis=1).clip(0, 255).astype(np.uint8)
    return left, right


def test_fuzzy_correlation_equals_the_golden_model() -> None:
    left, right = graded_windows()
    expected = np.stack(rule_bases.correlation().evaluate(*correlation.fuzzy_inputs(left, right)), axis=1)
    assert len(set(expected[:, 1])) >= 10
    assert {0, 128, 255} < set(expected[:, 0])
    dut = FuzzyCorrelation()
    limit, pauses = 4 * len(left) * dut.latency_cycles, Pauses(gaps=100, stalls=180, seed=4)
    received = run_streams(dut, {"i": payloads(left, right)}, {"o": len(left)}, pauses=pauses, cycle_limit=limit)["o"]
    np.testing.assert_array_equal([(result.weight, result.rule) for result in received], expected)


@pytest.mark.parametrize(("variable", "factor"), [(0, Fraction(16, 9)), (1, Fraction(4, 81))], ids=["sad", "zssd"])
def test_scaling_is_exact_up_to_where_the_tables_end(variable: int, factor: Fraction) -> None:
    """Check every score with the constants by which the hardware multiplies."""
    limit, multiplier, shift = scale_constants(factor)
    scores = np.arange(limit)
    scaled = scores * multiplier >> shift
    np.testing.assert_array_equal(scaled, scores * factor.numerator // factor.denominator)
    assert rule_bases.correlation().inputs[variable].entries - 1 <= scaled[-1] <= 255


def test_a_result_takes_exactly_the_latency() -> None:
    check_latency(FuzzyCorrelation())
