# amaranth: UnusedElaboratable=no
"""Sugeno systems equal the golden ones."""

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.fuzzy.sugeno import Rule, SugenoSystem, Variable
from golden_model.matching import rule_bases
from hdl.blocks.vectors import of_stream
from hdl.fuzzy.sugeno import Sugeno
from sim.benches.rows import check


def distinct(variable: Variable) -> list[int]:
    """The first index of each distinct column of degrees, and the first index beyond the tables."""
    columns = np.stack(list(variable.sets.values()))
    return [*np.sort(np.unique(columns, axis=1, return_index=True)[1]).tolist(), variable.entries]


def golden(system: SugenoSystem, inputs: list[Any]) -> NDArray[np.uint8]:
    """Weight and rule, one row for each input."""
    return np.stack(system.evaluate(*np.array(inputs).T), axis=1)


def check_inputs(system: SugenoSystem, value_bits: int, inputs: list[Any]) -> None:
    """The hardware answers the same, the first after exactly its latency, whatever gaps, stalls and a reset."""
    answers = [{"weight": weight, "rule": rule} for weight, rule in golden(system, inputs).tolist()]
    check(of_stream(Sugeno(system=system, value_bits=value_bits), "", inputs, answers))


@pytest.mark.parametrize(
    ("system", "value_bits", "step"),
    [
        (rule_bases.aerial(128), 8, 13),
        (rule_bases.aerial(24), 5, 1),
        (rule_bases.aerial_orientation(128), 8, 7),
        (rule_bases.aerial_orientation(256), 9, 11),
        pytest.param(rule_bases.aerial(128), 8, 1, marks=pytest.mark.slow),
        pytest.param(rule_bases.aerial_orientation(256), 9, 1, marks=pytest.mark.slow),
    ],
)
def test_product_systems_equal_the_golden_model_over_their_domain(
    system: SugenoSystem, value_bits: int, step: int
) -> None:
    """Every degree of each input; with a step of 1 in all combinations."""
    columns = [distinct(variable) for variable in system.inputs]
    inputs = list(itertools.product(*columns))[::step]
    assert [sorted(set(column)) for column in zip(*inputs, strict=True)] == columns
    check_inputs(system, value_bits, inputs)


@pytest.mark.parametrize("bits", [8, pytest.param(32, marks=pytest.mark.slow)])
def test_ilbp_equals_the_golden_model_over_its_whole_domain(bits: int) -> None:
    system = rule_bases.ilbp(bits)
    distances, sads, _ = (distinct(variable) for variable in system.inputs)
    inputs = [(distance, sad, sad) for distance in distances for sad in [*sads, 9 * 255]]
    check_inputs(system, 12, inputs)


def test_correlation_equals_the_golden_model_over_a_grid() -> None:
    """Combinations of 7 values for each input, from the cores and ramps of its sets to beyond its table."""
    system = rule_bases.correlation()
    grids = [np.array(distinct(variable)) for variable in system.inputs]
    inputs = list(itertools.product(*(grid[np.linspace(0, len(grid) - 1, 7).astype(int)].tolist() for grid in grids)))[
        ::3
    ]
    expected = golden(system, inputs)
    assert len(set(expected[:, 1])) == 27
    assert len(set(expected[:, 0])) > 40
    check_inputs(system, 9, inputs)


def test_a_rule_may_ignore_an_input_and_without_a_firing_rule_the_weight_is_0() -> None:
    near = Variable("near", {"yes": np.array([256, 100, 0])})
    rules = (Rule(("yes", None), 0.9), Rule((None, "yes"), 0.3))
    system = SugenoSystem("two", inputs=(near, near), rules=rules, conjunction="minimum")
    inputs = list(itertools.product(range(3), repeat=2))
    assert golden(system, inputs)[-1, 0] == 0
    check_inputs(system, 2, inputs)


def test_of_alternatives_the_strongest_counts_once() -> None:
    """OR: rules that join the one before; held against the maximum, over all inputs."""
    rising, falling = np.arange(9) * 32, 256 - np.arange(9) * 32
    peak = np.minimum(rising, falling) * 2
    a = Variable("a", {"low": falling, "high": rising})
    b = Variable("b", {"low": falling, "peak": peak})
    rules = (
        Rule(("low", None), 0.25),
        Rule((None, "peak"), 0.25, joins=True),
        Rule(("high", "low"), 0.25, joins=True),
        Rule(("high", "peak"), 0.75),
        Rule(("high", None), 0.875),
    )
    system = SugenoSystem("alternatives", inputs=(a, b), rules=rules, conjunction="minimum")
    inputs = list(itertools.product(range(9), repeat=2))
    x, y = np.array(inputs).T
    first = np.max([falling[x], peak[y], np.minimum(rising[x], falling[y])], axis=0)
    strengths = np.stack([first, np.minimum(rising[x], peak[y]), rising[x]], axis=1)
    mean = strengths @ (64, 192, 224) / strengths.sum(axis=1)
    np.testing.assert_allclose(golden(system, inputs)[:, 0], mean, atol=0.5)
    check_inputs(system, 4, inputs)


def test_product_of_too_many_inputs_is_refused() -> None:
    always = Variable("always", {"yes": np.array([256])})
    rule = Rule(("yes",) * 4, 1.0)
    system = SugenoSystem("four", inputs=(always,) * 4, rules=(rule,), conjunction="product")
    with pytest.raises(ValueError, match="four: multiplies 4 inputs; valid: 2, 3"):
        Sugeno(system=system, value_bits=1)
