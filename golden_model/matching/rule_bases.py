"""The fuzzy systems of the matcher: the ``aerial`` preset's, and the thesis's fuzzy ILBP and fuzzy correlation."""

import itertools
import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from golden_model.matching.correlation import NCC, SAD_PER_PIXEL, ZSSD_PER_PIXEL
from golden_model.matching.fuzzy import (
    ONE,
    Rule,
    SugenoSystem,
    Table,
    Variable,
    quantise_degrees,
    ramp,
    sigmoid,
    trapezoid,
)


@lru_cache
def aerial(bits: int) -> SugenoSystem:
    """The rule base of the ``aerial`` preset: product, 8 rules, no division.

    Inputs: Hamming distance (low up to .10 of ``bits``, high from .34), margin to the second best (big from .10 of
    ``bits``), and the difference between the match's relative orientation and the most common one, in sectors. A match
    belongs fully to the common orientation up to one sector, .6 at two sectors, .2 at three, and not beyond. The values
    come from ablation on real flights.
    """
    belonging = quantise_degrees(np.array([1.0, 1.0, 0.6, 0.2, 0.0]))
    outputs = {
        ("low", "big"): (1.0, 0.15),
        ("low", "small"): (0.6, 0.05),
        ("high", "big"): (0.6, 0.02),
        ("high", "small"): (0.2, 0.0),
    }
    return SugenoSystem(
        "aerial",
        inputs=(
            _falling_distance(bits, 0.10, 0.34),
            _rising_margin(bits, 0.0, 0.10),
            _complementary("orientation", belonging, ("common", "other")),
        ),
        rules=tuple(
            Rule((*sets, orientation), output)
            for sets, pair in outputs.items()
            for orientation, output in zip(("common", "other"), pair, strict=True)
        ),
        conjunction="product",
    )


@lru_cache
def aerial_orientation(bits: int) -> SugenoSystem:
    """The 4-rule system of distance and margin; its squared weight is a match's vote for a relative orientation."""
    return SugenoSystem(
        "aerial_orientation",
        inputs=(_falling_distance(bits, 0.10, 0.34), _rising_margin(bits, 0.01, 0.14)),
        rules=(
            Rule(("low", "big"), 1.0),
            Rule(("low", "small"), 0.35),
            Rule(("high", "big"), 0.5),
            Rule(("high", "small"), 0.0),
        ),
        conjunction="product",
    )


@lru_cache
def ilbp(bits: int) -> SugenoSystem:
    """The thesis's fuzzy ILBP: minimum, 4 rules over Hamming distance and the belongings r1 and r2.

    The thesis gives neither the corners of the sets nor which SAD determines which belonging. Our reading: both
    belongings follow from the SAD (equation III-1) between the 3x3 gray windows of the two features, taken as the raw
    sum over 9 pixels. The SAD is symmetric, so r1 = r2 = r. Rules 3 and 4, which require one belonging without the
    other, therefore fire only for 0 < r < 1. At low distance and r <= 1/2, rules 1 and 3 balance: weight 1/2.

    The sigmoid is centred at 9.5 gray levels per pixel, midway between the SAD that Table III-1 calls surely good (6)
    and surely bad (13), where it is .95 and .05. The distance is low up to 1/8 of ``bits`` and high from 3/8. The two
    sets cross at 1/4, which is 2.8 standard deviations below the mean distance of unrelated descriptors of 32
    independent bits; the mean itself (1/2) is entirely high. Match is 1, no match 0, also where no rule fires.
    """
    window_px, good, bad = 9, 6.0, 13.0
    # The logistic function is .95 at ln(.95 / .05) and .05 at minus that: one slope meets both bounds.
    slope = 2 * math.log(0.95 / 0.05) / ((bad - good) * window_px)
    # From 153 on, 17 gray levels per pixel, the belonging rounds to 0.
    belongs = sigmoid(154, (good + bad) / 2 * window_px, -slope)
    return SugenoSystem(
        "ilbp",
        inputs=(
            _falling_distance(bits, 1 / 8, 3 / 8),
            _complementary("SAD of r1", belongs, ("belongs", "does not")),
            _complementary("SAD of r2", belongs, ("belongs", "does not")),
        ),
        rules=(
            Rule(("low", "belongs", "belongs"), 1.0),
            Rule(("high", "does not", "does not"), 0.0),
            Rule(("low", "does not", "belongs"), 0.0),
            Rule(("high", "belongs", "does not"), 0.0),
        ),
        conjunction="minimum",
    )


@lru_cache
def correlation() -> SugenoSystem:
    """The thesis's fuzzy correlation (Tables III-1, III-2): minimum, 27 rules over SAD, ZSSD and NCC.

    Inputs are scaled by `golden_model.matching.correlation.fuzzy_inputs`. Sets ramp where the ranges of the table
    overlap. The thesis does not give the lower edge of the medium NCC; here it ramps from .25 to .3. Any bad input
    gives a bad match (0), two or three good inputs a good match (1), everything else a medium match (.5).
    """
    sad = _good_medium_bad("SAD", np.array([4, 6, 13, 15]) * SAD_PER_PIXEL.one)
    zssd = _good_medium_bad("ZSSD", np.array([20, 30, 45, 50]) * ZSSD_PER_PIXEL.one)
    ncc = _good_medium_bad("NCC", np.array([0.55, 0.5, 0.3, 0.25]) * NCC.one)

    def output(sets: tuple[str, ...]) -> float:
        if "bad" in sets:
            return 0.0
        return 1.0 if sets.count("good") >= 2 else 0.5

    return SugenoSystem(
        "correlation",
        inputs=(sad, zssd, ncc),
        rules=tuple(Rule(sets, output(sets)) for sets in itertools.product(("good", "medium", "bad"), repeat=3)),
        conjunction="minimum",
    )


def _complementary(name: str, table: Table, names: tuple[str, str]) -> Variable:
    """A variable with two sets that sum to one: ``table`` has the first name, its complement the second."""
    return Variable(name, {names[0]: table, names[1]: ONE - table})


def _falling_distance(bits: int, one_until: float, zero_from: float) -> Variable:
    # The last entry is the first that is entirely high; larger distances read it, too.
    table = ramp(math.ceil(zero_from * bits) + 1, zero_from * bits, one_until * bits)
    return _complementary("distance", table, ("low", "high"))


def _rising_margin(bits: int, zero_until: float, one_from: float) -> Variable:
    table = ramp(math.ceil(one_from * bits) + 1, zero_until * bits, one_from * bits)
    return _complementary("margin", table, ("big", "small"))


def _good_medium_bad(name: str, corners: NDArray[np.floating | np.integer]) -> Variable:
    """Three overlapping sets: good up to the first corner, medium from the second to the third, bad from the fourth."""
    entries = math.ceil(corners.max()) + 1
    sets = {
        "good": ramp(entries, corners[1], corners[0]),
        "medium": trapezoid(entries, corners),
        "bad": ramp(entries, corners[2], corners[3]),
    }
    return Variable(name, sets)
