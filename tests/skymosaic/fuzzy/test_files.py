"""FLL against FuzzyLite's own Python library, FCL against systems worked by hand."""

import math
from pathlib import Path

import numpy as np
import pytest

from skymosaic.errors import InputError
from skymosaic.fuzzy.fcl import read_fcl, write_fcl
from skymosaic.fuzzy.files import SHIPPED, load_system
from skymosaic.fuzzy.fll import read_fll, write_fll
from skymosaic.fuzzy.system import FuzzySystem, IfThen, Input, Output
from skymosaic.fuzzy.terms import Term

fuzzylite = pytest.importorskip("fuzzylite")

SHIPPED_NAMES = ("correlation", "ilbp", "ransac")
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


def inputs_of(system: FuzzySystem, count: int = 200) -> list[np.ndarray]:
    rng = np.random.default_rng(7)
    inside = [rng.uniform(variable.low, variable.high, count) for variable in system.inputs]
    return [np.append(values, (v.low, v.high)) for values, v in zip(inside, system.inputs, strict=True)]


def by_fuzzylite(text: str, values: list[np.ndarray]) -> np.ndarray:
    # By default it ignores rules whose strength is below 0.001.
    fuzzylite.lib.abs_tolerance = 0.0
    engine = fuzzylite.FllImporter().from_string(text)
    found = []
    for row in zip(*values, strict=True):
        for variable, value in zip(engine.input_variables, row, strict=True):
            variable.value = float(value)
        engine.process()
        found.append(engine.output_variables[0].value)
    return np.array(found)


SYSTEMS = [*SHIPPED_NAMES, "minimum", "product"]


def system_named(name: str) -> FuzzySystem:
    return load_system(SHIPPED / f"{name}.fll") if name in SHIPPED_NAMES else every_shape(name)


@pytest.mark.parametrize("name", SYSTEMS)
def test_fll_round_trip_and_values_of_fuzzylite(name: str) -> None:
    system = system_named(name)
    text = write_fll(system)
    assert read_fll(text) == system
    values = inputs_of(system)
    np.testing.assert_allclose(system.evaluate(*values), by_fuzzylite(text, values), atol=1e-12)
    # What FuzzyLite writes of it is read, too.
    theirs = fuzzylite.FllExporter().to_string(fuzzylite.FllImporter().from_string(text))
    np.testing.assert_allclose(read_fll(theirs).evaluate(*values), system.evaluate(*values), atol=2e-3)


@pytest.mark.parametrize("name", SYSTEMS)
def test_fcl_round_trip(name: str) -> None:
    system = system_named(name)
    values = inputs_of(system)
    # A sigmoid becomes 65 points, everything else stays exact.
    curved = any(term.shape == "Sigmoid" for variable in system.inputs for term in variable.terms.values())
    found = read_fcl(write_fcl(system)).evaluate(*values)
    np.testing.assert_allclose(found, system.evaluate(*values), atol=5e-3 if curved else 1e-12)


VALVE = """
FUNCTION_BLOCK valve  (* after the example in IEC 61131-7 *)
VAR_INPUT
  temp : REAL;  pressure : REAL;
END_VAR
VAR_OUTPUT  valve : REAL;  END_VAR
FUZZIFY temp
  TERM cold := (3, 1) (27, 0);
  TERM hot := (3, 0) (27, 1);   // they cross at 15
END_FUZZIFY
FUZZIFY pressure
  TERM low := (55, 1) (95, 0);
  TERM high := (55, 0) (95, 1);
END_FUZZIFY
DEFUZZIFY valve
  TERM drainage := -100;  TERM closed := 0;  TERM inlet := 100;
  METHOD : COGS;
  DEFAULT := 0;
  RANGE := (-100 .. 100);
END_DEFUZZIFY
RULEBLOCK No1
  AND : MIN;
  RULE 1 : IF temp IS cold AND pressure IS low THEN valve IS inlet;
  RULE 2 : IF temp IS cold AND pressure IS high THEN valve IS closed;
  RULE 3 : IF (temp IS hot) AND (pressure IS low) THEN valve IS closed;
  RULE 4 : IF temp IS hot AND pressure IS high THEN valve IS drainage;
END_RULEBLOCK
END_FUNCTION_BLOCK
"""


@pytest.mark.parametrize(
    ("conjunction", "temp", "pressure", "valve"),
    [
        ("MIN", 3, 55, 100),
        ("MIN", 27, 95, -100),
        # cold 3/4, hot 1/4; low 1/2, high 1/2: strengths 1/2, 1/2, 1/4, 1/4; 100 (1/2 - 1/4) / (3/2)
        ("MIN", 9, 75, 100 / 6),
        # Beyond the points the end's degree holds: cold 1; low 1/4, high 3/4.
        ("MIN", -20, 85, 25),
        # cold 3/4, hot 1/4; low 1/4, high 3/4: products 3/16, 9/16, 1/16, 3/16; they sum to one.
        ("PROD", 9, 85, 0),
        # cold 1/4, hot 3/4; low 1/4, high 3/4: 100 (1/16 - 9/16)
        ("PROD", 21, 85, -50),
    ],
)
def test_fcl_gives_what_was_worked_by_hand(conjunction: str, temp: float, pressure: float, valve: float) -> None:
    system = read_fcl(VALVE.replace("AND : MIN", f"AND : {conjunction}"))
    assert system.evaluate(np.array([temp]), np.array([pressure]))[0] == pytest.approx(valve)


@pytest.mark.parametrize(
    ("suffix", "old", "new", "says"),
    [
        (".fcl", "IF temp IS cold AND", "IF temp IS cold OR", "not or"),
        (".fcl", "temp IS hot AND", "temp IS warm AND", "temp has no term warm; it has cold, hot"),
        (".fcl", "METHOD : COGS", "METHOD : COG", "COGS is supported"),
        (".fcl", "TERM inlet := 100", "TERM inlet := (1, 0) (2, 1)", "order zero"),
        (".fcl", "(27, 0)", "(27, 0", "points"),
        (".fcl", "THEN valve IS closed", "THEN tap IS closed", "valve is CONSTANT"),
        (".fcl", "FUNCTION_BLOCK valve", "", "FUNCTION_BLOCK"),
        (".fll", "conjunction: Minimum", "conjunction: HamacherProduct", "HamacherProduct; valid: Minimum"),
        (".fll", "Ramp 0.375 0.125", "Ramp 0.375", "Ramp takes 2 numbers, not 1"),
        (".fll", "Ramp 0.375 0.125", "Gaussian 0.3 0.1", "Gaussian is not known"),
        (".fll", "Ramp 0.375 0.125", "Ramp nought 0.125", "line 7"),
        (".fll", "then match is yes", "then match is yes with 0.5", "not with"),
        (".fll", "WeightedAverage TakagiSugeno", "Centroid 100", "WeightedAverage is supported"),
        (".fll", "range: 0 1", "rang: 0 1", "rang is not known"),
    ],
)
def test_a_wrong_file_is_one_line_that_names_it(tmp_path: Path, suffix: str, old: str, new: str, says: str) -> None:
    text = VALVE if suffix == ".fcl" else (SHIPPED / "ilbp.fll").read_text()
    assert old in text
    path = tmp_path / f"wrong{suffix}"
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError) as refused:
        load_system(path)
    assert says in str(refused.value)
    assert str(refused.value).startswith(str(path))
