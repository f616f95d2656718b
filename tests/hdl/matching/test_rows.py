# amaranth: UnusedElaboratable=no
"""The correlations answer as the golden model, at the extremes of every score."""

from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.matching import correlation, rule_bases
from hdl.blocks.catalogue import correlation_scores, fuzzy_correlation
from hdl.blocks.vectors import Block, of_stream
from hdl.matching.correlation import PIXELS, SumOfAbsoluteDifferences
from hdl.matching.fuzzy_correlation import scale_constants
from tests.hdl.rows import Clocked, row_test


def windows() -> NDArray[np.uint8]:
    """Pairs of windows (2, N, 9): random, similar, the extremes of every score, flat, black, single pixels."""
    rng = np.random.default_rng(5)
    any_pair = rng.integers(0, 256, (2, 20, PIXELS))
    near = rng.integers(0, 256, (20, PIXELS))
    alike = np.stack([near, (near + rng.integers(-9, 10, near.shape)).clip(0, 255)])
    gain = np.stack([near, near // 2])
    flat = np.repeat(rng.integers(0, 256, (2, 8, 1)), PIXELS, axis=2)
    dots = np.eye(PIXELS, dtype=int)[:, [0, 4, 8, 4]].T * rng.integers(1, 256, (2, 4, 1))
    half = np.arange(PIXELS) % 2 * 255
    black, white = np.zeros(PIXELS, int), np.full(PIXELS, 255)
    extremes = np.array([[half, black, black, white, white, half], [255 - half, black, white, black, white, half]])
    return np.concatenate([any_pair, alike, gain, flat, dots, extremes], axis=1).astype(np.uint8)


def graded_windows() -> NDArray[np.uint8]:
    """Pairs of decreasing similarity whose scores cover the rules' sets: bright ones and, for NCC, dark ones."""
    rng = np.random.default_rng(5)
    spread = np.linspace(0, 24, 40)[:, np.newaxis]
    bright = rng.integers(60, 200, (40, PIXELS))
    offset = rng.integers(-12, 13, (40, 1)) * rng.integers(0, 2, (40, 1))
    bright = np.stack([bright, bright + rng.normal(size=bright.shape) * spread + offset])
    shared, own = rng.integers(0, 24, (40, PIXELS)), rng.integers(0, 24, (2, 40, PIXELS))
    dark = shared * rng.integers(0, 2, shared.shape) + own * (rng.integers(0, 3, own.shape) == 0)
    return np.asarray(np.concatenate([bright, dark], axis=1).clip(0, 255), np.uint8)


def scores() -> Block:
    block = correlation_scores(windows())
    found = np.array([[*row.values()] for row in block.outputs["o"]])
    assert found.min(axis=0).tolist() == [0, 0, 0]
    assert found.max(axis=0).tolist() == [9 * 255, 81 * 255**2 - 255**2, 256]
    return block


def fuzzy() -> Block:
    block = fuzzy_correlation(graded_windows())
    weights, rules = ({row[name] for row in block.outputs["o"]} for name in ("o_weight", "o_rule"))
    assert len(rules) >= 10
    assert {0, 128, 255} < weights
    return block


def sum_of_differences() -> Block:
    pairs = windows()
    clocked = Clocked(SumOfAbsoluteDifferences(pixels=PIXELS))
    sent = [dict(zip(("left", "right"), pair, strict=True)) for pair in pairs.swapaxes(0, 1).tolist()]
    return of_stream(clocked, "", sent, [{"sum": each} for each in correlation.sad(*pairs).tolist()])


test_rows = row_test({"scores": scores, "fuzzy": fuzzy, "sum of differences": sum_of_differences})


@pytest.mark.parametrize(("variable", "factor"), [(0, Fraction(16, 9)), (1, Fraction(4, 81))], ids=["sad", "zssd"])
def test_scaling_is_exact_up_to_where_the_tables_end(variable: int, factor: Fraction) -> None:
    """Check every score with the constants by which the hardware multiplies."""
    limit, multiplier, shift = scale_constants(factor)
    scores = np.arange(limit)
    scaled = scores * multiplier >> shift
    np.testing.assert_array_equal(scaled, scores * factor.numerator // factor.denominator)
    assert rule_bases.correlation().inputs[variable].entries - 1 <= scaled[-1] <= 255
