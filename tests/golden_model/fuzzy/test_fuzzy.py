"""Terms, tables, rules and systems in real numbers and in fixed point, against FuzzyLite and worked by hand."""

import math
from typing import Any

import numpy as np
import pytest

from golden_model.fuzzy.fll import read_fll
from golden_model.fuzzy.sugeno import Rule, SugenoSystem, Variable
from golden_model.fuzzy.system import FuzzySystem, IfThen, Input, Output, make_tables
from golden_model.fuzzy.terms import Term
from golden_model.matching.rule_bases import aerial
from tests.golden_model.fuzzy.valve import PRODUCT, VALVE

fuzzylite = pytest.importorskip("fuzzylite")
TERMS = [
    ("Ramp", (-1.0, 2.0)),
    ("Ramp", (2.5, 0.5)),
    ("Triangle", (-1.0, 0.25, 3.0)),
    ("Triangle", (-1.0, -1.0, 3.0)),
    ("Triangle", (-math.inf, 0.0, 1.0)),
    ("Trapezoid", (-2.0, -1.0, 1.0, 3.5)),
    ("Trapezoid", (-math.inf, -1.0, 0.0, 2.0)),
    ("Trapezoid", (-1.0, 0.0, 2.0, math.inf)),
    ("Trapezoid", (-1.0, -1.0, 2.0, 2.0)),
    ("Rectangle", (-0.5, 1.5)),
    ("Sigmoid", (0.5, -3.0)),
    ("Discrete", (-2.0, 0.0, -1.0, 0.75, 1.0, 0.5, 3.0, 1.0)),
    ("ZShape", (-1.0, 2.0)),
    ("SShape", (-2.5, 1.0)),
    ("PiShape", (-2.0, 0.0, 1.0, 3.0)),
    ("PiShape", (-2.0, -2.0, 1.0, 1.0)),
    ("PiShape", (0.0, 1.0, 1.0, 2.0)),
    ("Gaussian", (0.5, 1.2)),
    ("GaussianProduct", (-1.0, 0.5, 1.0, 2.0)),
    ("GaussianProduct", (1.0, 2.0, -1.0, 0.5)),
    ("Bell", (0.5, 1.5, 3.0)),
    ("Bell", (-1.0, -2.0, 0.7)),
    ("Cosine", (0.5, 3.0)),
    ("Spike", (0.5, 2.0)),
    ("SigmoidDifference", (-1.0, 4.0, 5.0, 2.0)),
    ("SigmoidProduct", (-1.0, 4.0, -5.0, 2.0)),
]


@pytest.mark.parametrize(("shape", "parameters"), TERMS)
def test_degrees_are_those_of_fuzzylite(shape: str, parameters: tuple[float, ...]) -> None:
    theirs = getattr(fuzzylite, shape)("term")
    theirs.configure(" ".join(map(str, parameters)))
    x = np.concatenate((np.linspace(-4, 5, 181), [each for each in parameters if math.isfinite(each)]))
    expected = [theirs.membership(float(each)) for each in x]
    np.testing.assert_allclose(Term("term", shape, parameters).degree(x), expected, atol=1e-12)


def test_a_step_is_at_its_upper_end_and_overflows_nowhere() -> None:
    term = Term("steps", "Discrete", (0.0, 0.25, 1.0, 0.25, 1.0, 1.0, 2.0, 1.0, 2.0, 0.5, 3.0, 0.0))
    assert term.degree(np.array([0.5, 1.0, 1.5, 2.0, 2.5, 4.0])).tolist() == [0.25, 1.0, 1.0, 1.0, 0.25, 0.0]
    degree = Term("step", "Sigmoid", (0.5, 2000.0)).degree(np.array([-4.0, 0.5, 5.0]))
    np.testing.assert_allclose(degree, [0.0, 0.5, 1.0], atol=1e-12)


@pytest.mark.parametrize(
    ("shape", "parameters", "message"),
    [
        ("Arc", (0.0, 1.0), "shape Arc is not known; valid: Ramp, Triangle"),
        ("Ramp", (1.0,), "Ramp takes 2 numbers, not 1"),
        ("Trapezoid", (1.0, 2.0, 3.0), "Trapezoid takes 4 numbers, not 3"),
        ("Discrete", (1.0, 0.0), "at least two points of two numbers, not 2"),
        ("Discrete", (1.0, 0.0, 2.0), "at least two points of two numbers, not 3"),
        ("Discrete", (1.0, 0.0, 2.0, 1.0, 3.0), "at least two points of two numbers, not 5"),
        ("Sigmoid", (math.nan, 1.0), "a parameter is not a number"),
        ("Triangle", (0.0, 2.0, 1.0), "Triangle needs rising positions"),
        ("Discrete", (1.0, 0.0, 0.0, 1.0), "Discrete needs rising positions"),
        ("Ramp", (1.0, 1.0), "Ramp needs two different positions"),
        ("Gaussian", (1.0, 0.0), "a width of 0"),
        ("ZShape", (2.0, 1.0), "rising positions"),
        ("SShape", (1.0, 1.0), "two different positions"),
    ],
)
def test_wrong_parameters_are_refused(shape: str, parameters: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=f"term low: .*{message}"):
        Term("low", shape, parameters)


HALF_STEP = 1 / 512
"""Largest error of a degree that is rounded to 8 fraction bits."""
INDEX = np.arange(50)


def table(shape: str, *parameters: float, trimmed: bool = False) -> np.ndarray:
    """The table of one term, in units of the index."""
    variable = Input("x", 0.0, 49.0, {"a": Term("a", shape, parameters)})
    system = FuzzySystem("s", (variable,), Output("z", -1.0, 3.0, {"c": 2.0}), (IfThen({"x": "a"}, "c"),), "minimum")
    tables = make_tables(system, [INDEX.astype(float)], trimmed=trimmed)
    assert tables.rules[0].output == 0.75, "a share of the output's range"
    return tables.inputs[0].sets["a"]


def test_degrees_are_within_half_a_step_and_tables_end_where_they_stay() -> None:
    expected = np.interp(INDEX, [3, 10, 20, 41], [0, 1, 1, 0])
    assert np.abs(table("Trapezoid", 3, 10, 20, 41) / 256 - expected).max() <= HALF_STEP
    assert np.abs(table("Sigmoid", 20, -0.3) / 256 - 1 / (1 + np.exp(0.3 * (INDEX - 20)))).max() <= HALF_STEP
    assert len(table("Ramp", 3, 9)) == 50
    assert table("Ramp", 3, 9, trimmed=True).tolist() == [0, 0, 0, 0, 43, 85, 128, 171, 213, 256]
    assert table("Ramp", 60, 59, trimmed=True).tolist() == [256]


def crisp(name: str, *tables: list[int]) -> Variable:
    return Variable(name, {f"s{i}": np.array(table) for i, table in enumerate(tables)})


def test_minimum_divides_rounding_half_up_and_ties_go_to_the_first_rule() -> None:
    system = SugenoSystem(
        "halves",
        inputs=(crisp("a", [256, 3], [256, 1], [256, 3]),),
        rules=(Rule(("s1",), 1.0), Rule(("s0",), 0.5), Rule(("s2",), 0.0)),
        conjunction="minimum",
    )
    weight, rule = system.evaluate(np.array([0, 1]))
    # (256 + 128 + 0) / 3 = 128 exactly; (256 + 3 * 128) / 7 = 91.43.
    assert weight.tolist() == [128, 91]
    assert rule.tolist() == [0, 1]
    half = SugenoSystem(
        "half",
        inputs=(crisp("a", [1], [1]),),
        rules=(Rule(("s0",), 0.0), Rule(("s1",), 1 / 256)),
        conjunction="minimum",
    )
    assert half.evaluate(np.array([0]))[0].item() == 1


def test_a_rule_may_leave_an_input_out() -> None:
    system = SugenoSystem(
        "partial",
        inputs=(crisp("a", [256, 64], [0, 192]), crisp("b", [256, 0], [0, 256])),
        rules=(Rule(("s0", None), 1.0), Rule(("s1", "s0"), 0.5), Rule(("s1", "s1"), 0.0)),
        conjunction="product",
    )
    assert system.evaluate(np.array([0, 1, 1]), np.array([1, 0, 1]))[0].tolist() == [255, 64 + 96, 64]


GOOD = crisp("a", [256, 0], [0, 256])
RULES = (Rule(("s0",), 1.0), Rule(("s1",), 0.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rules": ()}, "has 0 rules; it must have 1 to 32"),
        ({"rules": (Rule(("s0",), 1.0),)}, r"strengths sum to 0.0000 at a 1; make the sets complementary"),
        ({"inputs": (crisp("a", [256, 100], [0, 150]),)}, r"strengths sum to 0.9766 at a 1"),
        ({"rules": (*RULES, Rule(("s1",), 0.0, joins=True))}, "rule 2: OR needs conjunction 'minimum'"),
        ({"rules": (Rule(("s0",), 1.0, joins=True),), "conjunction": "minimum"}, "rule 0: OR needs"),
        ({"rules": (*RULES, Rule(("s1",), 1.0, joins=True)), "conjunction": "minimum"}, "rule 2: .* the same output"),
    ],
)
def test_impossible_system_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SugenoSystem("s", **({"inputs": (GOOD,), "rules": RULES, "conjunction": "product"} | change))


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ((), "one or more sets"),
        (([1], [1, 2]), "one length"),
        (([257],), "0 to 256"),
        (([-1],), "0 to 256"),
        (([],), "0 to 256"),
    ],
)
def test_impossible_variable_is_refused(tables: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        crisp("a", *tables)


def test_wrong_inputs_are_refused() -> None:
    system = aerial(128)
    assert [each.size for each in system.evaluate(*[np.zeros(0, int)] * 3)] == [0, 0]
    with pytest.raises(ValueError, match="takes 3 inputs, not 1"):
        system.evaluate(np.array([1]))
    with pytest.raises(ValueError, match="margin: value -2 is negative"):
        system.evaluate(np.array([1]), np.array([-2]), np.array([0]))


@pytest.mark.parametrize(
    ("text", "temp", "pressure", "valve"),
    [
        (VALVE, 3, 55, 100),
        (VALVE, 27, 95, -100),
        # cold 3/4, hot 1/4; low 1/2, high 1/2: strengths 1/2, 1/2, 1/4, 1/4; 100 (1/2 - 1/4) / (3/2)
        (VALVE, 9, 75, 100 / 6),
        # Beyond a ramp its end's degree holds: cold 1; low 1/4, high 3/4.
        (VALVE, -20, 85, 25),
        # cold 3/4, hot 1/4; low 1/4, high 3/4: products 3/16, 9/16, 1/16, 3/16; they sum to one.
        (PRODUCT, 9, 85, 0),
        # cold 1/4, hot 3/4; low 1/4, high 3/4: 100 (1/16 - 9/16)
        (PRODUCT, 21, 85, -50),
    ],
)
def test_the_output_is_what_was_worked_by_hand(text: str, temp: float, pressure: float, valve: float) -> None:
    assert read_fll(text).evaluate(np.array([temp]), np.array([pressure]))[0] == pytest.approx(valve)
