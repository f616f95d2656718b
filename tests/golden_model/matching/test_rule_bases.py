"""The matcher's fuzzy systems are the published ones: corners, rules and outputs, and what they give for any input.

In `tests/golden_model/fuzzy`, `test_rules.py` has the tables of `aerial` and `ilbp`, `test_fll.py` FuzzyLite's answers.
"""

import itertools

import numpy as np
import pytest

from golden_model.fuzzy.fll import read_fll
from golden_model.fuzzy.rules import read_shipped
from golden_model.fuzzy.sugeno import ONE, SugenoSystem
from golden_model.matching import rule_bases

HALF_STEP = 1 / 512
"""Largest error of a degree, a singleton or the final weight rounded to 8 fraction bits."""


def check_ramps(system: SugenoSystem, number: int, sets: dict[str, list[tuple[float, float]]]) -> None:
    """The sets of an input are straight between corners, which are (entry, degree), and level beyond them."""
    assert list(system.inputs[number].sets) == list(sets)
    for name, corners in sets.items():
        table = system.inputs[number].sets[name]
        entries = np.arange(len(table) + 9)
        degrees = np.interp(entries, *np.array(corners).T)
        assert np.abs(table[np.minimum(entries, len(table) - 1)] / ONE - degrees).max() <= HALF_STEP + 1e-9


def check_weights(system: SugenoSystem, name: str, per_unit: list[float]) -> None:
    """At entries drawn by lot, the weight is that of real numbers but for what is rounded.

    A product system is multilinear with slopes of at most 1 in each degree. A minimum system divides by the sum of
    strengths, so each strength's error enters with (output - weight) / sum. The dominant rule is the strongest.
    """
    rng = np.random.default_rng(1)
    grid = [rng.integers(0, each.entries + 2, 20_000) for each in system.inputs]
    # Beyond the last entry the table reads its end.
    read = [np.minimum(axis, each.entries - 1) for axis, each in zip(grid, system.inputs, strict=True)]
    real = read_fll(read_shipped(name))
    values = [axis / unit for axis, unit in zip(read, per_unit, strict=True)]
    strengths, expected = real.strengths(*values), real.evaluate(*values)
    total = strengths.sum(axis=1)
    got, dominant = system.evaluate(*grid)
    tolerance = np.full(len(total), (len(system.inputs) + 2) * HALF_STEP)
    if system.conjunction == "minimum":
        pull = np.abs([rule.output for rule in system.rules] - expected[:, np.newaxis]).sum(axis=1)
        tolerance = 2 * HALF_STEP + pull * HALF_STEP / np.maximum(total - len(system.rules) * HALF_STEP, 1e-9)
    # 255 may stand for anything from 254.5 / 256 on.
    error = np.abs(np.where(got == 255, 1.0, got / 256) - expected) - 2 * HALF_STEP * (got == 255)
    firm = total > 8 * HALF_STEP
    assert firm.mean() > 0.5
    assert (error <= tolerance)[firm].all()
    chosen = strengths[np.arange(len(total)), dominant]
    assert (chosen >= strengths.max(axis=1) - 2 * len(system.inputs) * HALF_STEP).all()


def test_aerial_weighs_as_its_rules_say() -> None:
    system = rule_bases.aerial(128)
    weight, rule = system.evaluate(np.array([0, 128]), np.array([128, 0]), np.array([0, 8]))
    assert (weight.tolist(), rule.tolist()) == ([255, 0], [0, 7]), "a full weight saturates"
    check_weights(system, "aerial", [128, 128, 1])


def test_the_vote_for_an_orientation_is_as_published() -> None:
    system = rule_bases.aerial_orientation(128)
    check_ramps(system, 0, {"low": [(12.8, 1), (43.52, 0)], "high": [(12.8, 0), (43.52, 1)]})
    check_ramps(system, 1, {"big": [(1.28, 0), (17.92, 1)], "small": [(1.28, 1), (17.92, 0)]})
    both = itertools.product(("low", "high"), ("big", "small"))
    assert [(rule.sets, rule.singleton) for rule in system.rules] == list(zip(both, (256, 90, 128, 0), strict=True))
    check_weights(system, "aerial-turn", [128, 128])


@pytest.mark.parametrize("bits", [8, 32])
def test_ilbp_has_four_rules_over_distance_and_belongings(bits: int) -> None:
    system = rule_bases.ilbp(bits)
    yes, no = "belongs", "does_not"
    assert [(rule.sets, rule.output) for rule in system.rules] == [
        (("low", yes, yes), 1), (("high", no, no), 0), (("low", no, yes), 0), (("high", yes, no), 0),
    ]  # fmt: skip
    check_weights(system, "ilbp", [bits, 9, 9])


def test_ilbp_says_no_match_where_no_rule_fires() -> None:
    """None of the four rules covers a large distance with two windows that agree."""
    system = rule_bases.ilbp(32)
    assert not system.strengths(np.array([20]), np.array([0]), np.array([0])).any()
    weight, rule = system.evaluate(np.array([20]), np.array([0]), np.array([0]))
    assert (weight.item(), rule.item()) == (0, 0)


def test_correlation_is_that_of_tables_iii_1_and_iii_2() -> None:
    """In gray levels per pixel; the engine's units are 1/16, 1/4 and 1/256 of them."""
    system = rule_bases.correlation()
    for number, per_unit, (first, second, third, fourth) in (
        (0, 16, (4, 6, 13, 15)), (1, 4, (20, 30, 45, 50)), (2, 256, (0.25, 0.3, 0.5, 0.55)),
    ):  # fmt: skip
        a, b, c, d = (float(corner * per_unit) for corner in (first, second, third, fourth))
        low, high = [(a, 1.0), (b, 0.0)], [(c, 0.0), (d, 1.0)]
        medium = [(a, 0.0), (b, 1.0), (c, 1.0), (d, 0.0)]
        good, bad = (high, low) if number == 2 else (low, high)
        check_ramps(system, number, {"good": good, "medium": medium, "bad": bad})
    for rule, sets in zip(system.rules, itertools.product(("good", "medium", "bad"), repeat=3), strict=True):
        # One bad input is enough; two good ones make a good match.
        assert (rule.sets, rule.output) == (sets, 0 if "bad" in sets else 1 if sets.count("good") > 1 else 0.5)
    check_weights(system, "correlation", [16, 4, 256])
