"""FLL against FuzzyLite's own Python library."""

import math
from pathlib import Path

import numpy as np
import pytest

from skymosaic.errors import InputError
from skymosaic.fuzzy.fll import SHIPPED, load_system, read_fll
from skymosaic.fuzzy.system import FuzzySystem, IfThen, Input, Output
from skymosaic.fuzzy.terms import Term
from tests.skymosaic.fuzzy.valve import VALVE

fuzzylite = pytest.importorskip("fuzzylite")

TERMS = (
    Term("rising", "Ramp", (-1.0, 2.0)),
    Term("falling", "Ramp", (2.5, 0.5)),
    Term("tip", "Triangle", (-1.0, 0.25, 3.0)),
    Term("flat", "Trapezoid", (-2.0, -1.0, 1.0, 3.5)),
    Term("open", "Trapezoid", (-math.inf, -1.0, 0.0, 2.0)),
    Term("box", "Rectangle", (-0.5, 1.5)),
    Term("curve", "Sigmoid", (0.5, -3.0)),
    Term("line", "Discrete", (-2.0, 0.0, -1.0, 0.75, 1.0, 0.5, 3.0, 1.0)),
)


def every_shape(conjunction: str) -> FuzzySystem:
    x = Input("x", -3.0, 4.0, {term.name: term for term in TERMS})
    y = Input("y", 0.0, 1.0, {"low": Term("low", "Ramp", (1.0, 0.0)), "high": Term("high", "Ramp", (0.0, 1.0))})
    rules = tuple(
        IfThen({"x": term.name, "y": "low" if index % 2 else "high"}, f"c{index}") for index, term in enumerate(TERMS)
    )
    constants = {f"c{index}": index - 2.5 for index in range(len(TERMS))}
    rules += (IfThen({"y": "low"}, "c0"),)
    return FuzzySystem("shapes", (x, y), Output("z", -3.0, 6.0, constants, -1.0), rules, conjunction)


def draw_inputs(system: FuzzySystem, count: int = 200) -> list[np.ndarray]:
    rng = np.random.default_rng(7)
    inside = [rng.uniform(variable.low, variable.high, count) for variable in system.inputs]
    return [np.append(values, (v.low, v.high)) for values, v in zip(inside, system.inputs, strict=True)]


def evaluate_by_fuzzylite(text: str, values: list[np.ndarray]) -> np.ndarray:
    # By default it ignores rules whose strength is below 0.001.
    fuzzylite.lib.abs_tolerance = 0.0
    engine = fuzzylite.FllImporter().from_string(text)
    outputs = []
    for row in zip(*values, strict=True):
        for variable, value in zip(engine.input_variables, row, strict=True):
            variable.value = float(value)
        engine.process()
        outputs.append(engine.output_variables[0].value)
    return np.array(outputs)


SHAPES = """\
Engine: shapes
InputVariable: x
  enabled: true
  range: -3 4
  lock-range: false
  term: rising Ramp -1 2
  term: falling Ramp 2.5 0.5
  term: tip Triangle -1 0.25 3
  term: flat Trapezoid -2 -1 1 3.5
  term: open Trapezoid -inf -1 0 2
  term: box Rectangle -0.5 1.5
  term: curve Sigmoid 0.5 -3
  term: line Discrete -2 0 -1 0.75 1 0.5 3 1
InputVariable: y
  range: 0 1
  term: low Ramp 1 0
  term: high Ramp 0 1
OutputVariable: z
  range: -3 6
  aggregation: none
  defuzzifier: WeightedAverage TakagiSugeno
  default: -1
  lock-previous: false
  term: c0 Constant -2.5
  term: c1 Constant -1.5
  term: c2 Constant -0.5
  term: c3 Constant 0.5
  term: c4 Constant 1.5
  term: c5 Constant 2.5
  term: c6 Constant 3.5
  term: c7 Constant 4.5
RuleBlock: rules
  enabled: true
  conjunction: CONJUNCTION
  disjunction: none
  implication: none
  activation: General
  rule: if x is rising and y is high then z is c0
  rule: if x is falling and y is low then z is c1
  rule: if x is tip and y is high then z is c2
  rule: if x is flat and y is low then z is c3
  rule: if x is open and y is high then z is c4
  rule: if x is box and y is low then z is c5
  rule: if x is curve and y is high then z is c6
  rule: if x is line and y is low then z is c7
  rule: if y is low then z is c0
"""
TEXTS = {name: (SHIPPED / f"{name}.fll").read_text() for name in ("correlation", "ilbp", "ransac")}
TEXTS |= {
    "minimum": SHAPES.replace("CONJUNCTION", "Minimum"),
    "product": SHAPES.replace("CONJUNCTION", "AlgebraicProduct"),
}


@pytest.mark.parametrize("conjunction", ["minimum", "product"])
def test_every_shape_is_read(conjunction: str) -> None:
    assert read_fll(TEXTS[conjunction]) == every_shape(conjunction)


@pytest.mark.parametrize("name", TEXTS)
def test_values_are_those_of_fuzzylite(name: str) -> None:
    text = TEXTS[name]
    system = read_fll(text)
    values = draw_inputs(system)
    np.testing.assert_allclose(system.evaluate(*values), evaluate_by_fuzzylite(text, values), atol=1e-12)
    # What FuzzyLite writes of it is read, too.
    theirs = fuzzylite.FllExporter().to_string(fuzzylite.FllImporter().from_string(text))
    np.testing.assert_allclose(read_fll(theirs).evaluate(*values), system.evaluate(*values), atol=2e-3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("if temp is cold and", "if temp is cold or", "not or"),
        ("if temp is cold and", "if temp is warm and", "temp has no term warm; it has cold, hot"),
        ("inlet Constant 100", "inlet Ramp 1 2", "order zero"),
        ("then valve is closed", "then tap is closed", "valve is CONSTANT"),
        ("then valve is closed", "then valve is closed with 0.5", "not with"),
        ("RuleBlock: rules", "", "has 0 rule blocks"),
        ("conjunction: Minimum", "conjunction: HamacherProduct", "HamacherProduct; valid: Minimum"),
        ("Ramp 27 3", "Ramp 27", "Ramp takes 2 numbers, not 1"),
        ("Ramp 27 3", "Gaussian 0.3 0.1", "Gaussian is not known"),
        ("Ramp 27 3", "Ramp nought 3", "line 4"),
        ("WeightedAverage", "Centroid 100", "WeightedAverage is supported"),
        ("range: 3 27", "range: 3", "give two numbers"),
        ("range: 3 27", "rang: 3 27", "rang is not known"),
    ],
)
def test_a_wrong_file_is_one_line_that_names_it(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in VALVE
    path = tmp_path / "wrong.fll"
    path.write_text(VALVE.replace(old, new))
    with pytest.raises(InputError) as refused:
        load_system(path)
    assert message in str(refused.value)
    assert str(refused.value).startswith(str(path))


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"fuzzy systems end in \.fll"):
        load_system(tmp_path / "valve.fcl")
