"""The matcher's fuzzy systems equal `simpful` systems in real numbers, built from the published corners."""

import importlib
import itertools
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.matching import rule_bases

HALF_STEP = 1 / 512
"""Largest error of a degree, a singleton or the final weight rounded to 8 fraction bits."""


def simpful() -> Any:
    """The package, when a test needs it: it imports matplotlib.pyplot, which takes longer than these tests."""
    return importlib.import_module("simpful")


def falling(start: float, end: float, domain: int) -> list[Any]:
    return [[0, 1], [start, 1], [end, 0], [domain, 0]]


def rising(start: float, end: float, domain: int) -> list[Any]:
    return [[0, 0], [start, 0], [end, 1], [domain, 1]]


def reference(
    variables: dict[str, Any],
    outputs: dict[str, float],
    rules: list[tuple[tuple[str, str, str], str]] | Iterable[Any],
    operators: list[str] | None = None,
) -> Any:
    """A `simpful` system.

    ``variables`` maps each input to its sets, and each set to points or a function; ``rules`` are (sets, output).
    """
    system = simpful().FuzzySystem(operators=operators, show_banner=False, verbose=False)
    for name, sets in variables.items():
        fuzzy_sets = [
            simpful().FuzzySet(**{"points" if isinstance(shape, list) else "function": shape}, term=term)
            for term, shape in sets.items()
        ]
        system.add_linguistic_variable(name, simpful().LinguisticVariable(fuzzy_sets))
    for name, value in outputs.items():
        system.set_crisp_output_value(name, value)
    for sets, output in rules:
        clauses = [f"({name} IS {term})" for name, term in zip(variables, sets, strict=True)]
        antecedent = clauses[0]
        for clause in clauses[1:]:
            antecedent = f"({antecedent} AND {clause})"
        system.add_rules([f"IF {antecedent} THEN (w IS {output})"])
    return system


def infer(system: Any, names: dict[str, Any], grid: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weight (N,) and strengths (N, rules) of the reference at the rows of ``grid``."""
    weights, strengths = [], []
    for values in grid:
        for name, value in zip(names, values, strict=True):
            system.set_variable(name, float(value))
        weights.append(system.Sugeno_inference(["w"], ignore_warnings=True)["w"])
        strengths.append(system.get_firing_strengths())
    return np.array(weights), np.array(strengths)


def assert_close(
    system: SugenoSystem,
    grid: NDArray[np.int64],
    weight: NDArray[np.float64],
    strengths: NDArray[np.float64],
    outputs: list[float],
) -> None:
    """The weight is within the propagated rounding of degrees, singletons and weight.

    The dominant rule is as strong as the strongest rule of the reference, up to that rounding.

    A product system is multilinear with slopes of at most 1 in each degree. A minimum system divides by the sum of
    strengths, so each strength's error enters with (output - weight) / sum.
    """
    got, dominant = system.evaluate(*grid.T)
    error = np.abs(np.where(got == 255, 1.0, got / 256) - weight)
    if system.conjunction == "product":
        tolerance = np.full(len(grid), (len(system.inputs) + 2) * HALF_STEP)
    else:
        pull = np.abs(np.array(outputs) - weight[:, np.newaxis]).sum(axis=1)
        # Second order: the sum itself is off by as much as half a step a rule.
        total = np.maximum(strengths.sum(axis=1) - len(outputs) * HALF_STEP, 1e-9)
        tolerance = 2 * HALF_STEP + pull * HALF_STEP / total
    # 255 may stand for anything from 254.5 / 256 on.
    tolerance = np.where(got == 255, tolerance + 2 * HALF_STEP, tolerance)
    assert (error <= tolerance).all(), grid[np.argmax(error - tolerance)]
    chosen = strengths[np.arange(len(grid)), dominant]
    assert (chosen >= strengths.max(axis=1) - 2 * len(system.inputs) * HALF_STEP).all()


def grid_of(*axes: list[int] | range) -> NDArray[np.int64]:
    return np.array(list(itertools.product(*axes)))


def test_aerial_orientation_equals_simpful() -> None:
    bits = 128
    variables = {
        "d": {"low": falling(0.10 * bits, 0.34 * bits, bits), "high": rising(0.10 * bits, 0.34 * bits, bits)},
        "m": {"big": rising(0.01 * bits, 0.14 * bits, bits), "small": falling(0.01 * bits, 0.14 * bits, bits)},
    }
    outputs = {"a": 1.0, "b": 0.35, "c": 0.5, "e": 0.0}
    rules = zip(itertools.product(("low", "high"), ("big", "small")), outputs, strict=True)
    system = reference(variables, outputs, rules, ["AND_PRODUCT"])
    grid = grid_of(range(0, 60), range(0, 24))[::5]
    weight, strengths = infer(system, variables, grid)
    assert_close(rule_bases.aerial_orientation(bits), grid, weight, strengths, list(outputs.values()))


@pytest.mark.parametrize("bits", [8, 32])
def test_ilbp_equals_simpful(bits: int) -> None:
    """The sigmoid falls to 0.95 at 6 gray levels per pixel and to 0.05 at 13 (window of 9 pixels)."""
    slope = 2 * math.log(19) / (9 * (13 - 6))
    belongs = {"yes": simpful().InvSigmoid_MF(c=9 * 9.5, a=slope), "no": simpful().Sigmoid_MF(c=9 * 9.5, a=slope)}
    variables = {
        "d": {"low": falling(bits / 8, 3 * bits / 8, bits), "high": rising(bits / 8, 3 * bits / 8, bits)},
        "p": belongs,
        "q": belongs,
    }
    rules = [
        (("low", "yes", "yes"), "match"),
        (("high", "no", "no"), "none"),
        (("low", "no", "yes"), "none"),
        (("high", "yes", "no"), "none"),
    ]
    system = reference(variables, {"match": 1.0, "none": 0.0}, rules)
    grid = grid_of(range(0, bits // 2 + 1, bits // 8), range(0, 152, 10), range(0, 152, 10))[::3]
    weight, strengths = infer(system, variables, grid)
    fires = strengths.sum(axis=1) > 8 * HALF_STEP
    assert fires.mean() > 0.6
    assert_close(rule_bases.ilbp(bits), grid[fires], weight[fires], strengths[fires], [1.0, 0.0, 0.0, 0.0])


def test_ilbp_says_no_match_where_no_rule_fires() -> None:
    """None of the four rules covers a large distance with two windows that agree."""
    system = rule_bases.ilbp(32)
    assert not system.strengths(np.array([20]), np.array([0]), np.array([0])).any()
    weight, rule = system.evaluate(np.array([20]), np.array([0]), np.array([0]))
    assert (weight.item(), rule.item()) == (0, 0)


def test_correlation_equals_simpful() -> None:
    """Tables III-1 and III-2, in gray levels per pixel; the engine's units are 1/16, 1/4 and 1/256 of them."""
    variables = {
        "s": {
            "good": falling(4, 6, 99),
            "medium": [[0, 0], [4, 0], [6, 1], [13, 1], [15, 0], [99, 0]],
            "bad": rising(13, 15, 99),
        },
        "z": {
            "good": falling(20, 30, 99),
            "medium": [[0, 0], [20, 0], [30, 1], [45, 1], [50, 0], [99, 0]],
            "bad": rising(45, 50, 99),
        },
        "n": {
            "good": rising(0.5, 0.55, 1),
            "medium": [[0, 0], [0.25, 0], [0.3, 1], [0.5, 1], [0.55, 0], [1, 0]],
            "bad": falling(0.25, 0.3, 1),
        },
    }
    letters = {"G": "good", "M": "medium", "B": "bad"}
    outputs = {"GM": 1.0, "MM": 0.5, "BM": 0.0}
    table = dict.fromkeys(("GGG", "GGM", "GMG", "MGG"), "GM") | dict.fromkeys(("GMM", "MGM", "MMG", "MMM"), "MM")
    rules = [
        (tuple(letters[letter] for letter in key), table.get("".join(key), "BM"))
        for key in itertools.product("GMB", repeat=3)
    ]
    system = reference(variables, outputs, rules)
    grid = grid_of(
        [0, 64, 72, 85, 96, 150, 208, 219, 240, 4000],
        [0, 80, 97, 120, 180, 189, 200, 9000],
        [0, 64, 70, 77, 128, 135, 141, 256],
    )[::3]
    weight, strengths = infer(system, variables, np.minimum(grid / [16, 4, 256], [99, 99, 1]))
    assert_close(rule_bases.correlation(), grid, weight, strengths, [outputs[name] for _, name in rules])


def test_aerial_constants_are_the_nearest_integers() -> None:
    """Finer than the tolerance above, since the hardware is built with exactly these numbers."""
    system = rule_bases.aerial(128)
    assert [rule.singleton for rule in system.rules] == [256, 38, 154, 13, 154, 5, 51, 0]
    assert system.inputs[2].sets["common"].tolist() == [256, 256, 154, 51, 0]
    assert [rule.singleton for rule in rule_bases.aerial_orientation(128).rules] == [256, 90, 128, 0]


def test_weight_saturates_and_beyond_the_table_reads_its_end() -> None:
    weight, rule = rule_bases.aerial(128).evaluate(np.array([0, 128]), np.array([128, 0]), np.array([0, 8]))
    assert weight.tolist() == [255, 0]
    assert rule.tolist() == [0, 7]
