"""FLL against FuzzyLite's own Python library."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from golden_model.fuzzy.fll import load_system, read_fll
from golden_model.fuzzy.rules import SHIPPED
from golden_model.fuzzy.system import FuzzySystem
from skymosaic.cli.commands import app
from skymosaic.fuzzy.quantised import measure_errors, quantise
from tests.golden_model.fuzzy.valve import VALVE

fuzzylite = pytest.importorskip("fuzzylite")


def draw_inputs(system: FuzzySystem, count: int = 200) -> list[np.ndarray]:
    rng = np.random.default_rng(7)
    inside = [rng.uniform(variable.low, variable.high, count) for variable in system.inputs]
    return [np.append(values, (v.low, v.high)) for values, v in zip(inside, system.inputs, strict=True)]


def evaluate_by_fuzzylite(text: str, values: list[np.ndarray], output: int = 0) -> np.ndarray:
    # By default it ignores rules whose strength is below 0.001.
    fuzzylite.lib.abs_tolerance = 0.0
    engine = fuzzylite.FllImporter().from_string(text)
    outputs = []
    for row in zip(*values, strict=True):
        for variable, value in zip(engine.input_variables, row, strict=True):
            variable.value = float(value)
        engine.process()
        outputs.append(engine.output_variables[output].value)
    return np.array(outputs)


TEXTS = {path.stem: path.read_text() for path in sorted(SHIPPED.glob("*.fll"))}
"""By minimum and by product; `test_fuzzy` has the other shapes."""


@pytest.mark.parametrize("name", TEXTS)
def test_values_are_those_of_fuzzylite(name: str) -> None:
    text = TEXTS[name]
    system = read_fll(text)
    values = draw_inputs(system)
    np.testing.assert_allclose(system.evaluate(*values), evaluate_by_fuzzylite(text, values), atol=1e-12)
    # What FuzzyLite writes of it is read, too.
    theirs = fuzzylite.FllExporter().to_string(fuzzylite.FllImporter().from_string(text))
    np.testing.assert_allclose(read_fll(theirs).evaluate(*values), system.evaluate(*values), atol=2e-3)


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"fuzzy systems end in \.fll"):
        load_system(tmp_path / "valve.fcl")


SMALL = """\
InputVariable: x
  range: 0 6
  term: low Ramp 6 0
OutputVariable: z
  range: 0 1
  defuzzifier: WeightedAverage
  term: one Constant 1
RuleBlock: rules
  conjunction: Minimum
  rule: if x is low then z is one
"""


@pytest.mark.parametrize(
    ("text", "old", "new", "says"),
    [
        (VALVE, "if temp is cold and", "if temp is cold or", "disjunction is none; valid: Maximum"),
        (VALVE, "conjunction: Minimum", "conjunction: none", "conjunction is none; valid: Minimum"),
        (VALVE, "if temp is cold and", "if temp is very cold and", "terms stand alone here, without very"),
        (VALVE, "if temp is cold and", "if temp is warm and", "temp has no term warm; it has cold, hot"),
        (VALVE, "inlet Constant 100", "inlet Ramp 1 2", "order zero"),
        (VALVE, "then valve is closed", "then valve is closed with 0.5", "without with"),
        (VALVE, "RuleBlock: rules", "", "has 0 rule blocks"),
        (VALVE, VALVE, "", "has no output; add an OutputVariable"),
        (VALVE, "Ramp 27 3", "Ramp 27", "Ramp takes 2 numbers, not 1"),
        (VALVE, "Ramp 27 3", "Arc 0.3 0.1", "Arc is not known"),
        (VALVE, "Ramp 27 3", "Ramp nought 3", "line 4"),
        (VALVE, "WeightedAverage", "Centroid 100", "WeightedAverage is supported"),
        (VALVE, "range: 3 27", "range: 3", "give two numbers"),
        (VALVE, "range: 3 27", "rang: 3 27", "rang is not known"),
        (SMALL, "Ramp 6 0", "Ramp 6_0 0", "line 3: '6_0' is not a number"),
        (SMALL, "range: 0 6", "range: 0 6_0", "line 2: range is '0 6_0'"),
        (SMALL, "  term: one", "  term: one Constant 2\n  term: one", "line 8: z has another term"),
        (SMALL, "range: 0 6", "range: 0 6\n  range: 0 7", "line 3: range is given twice, first in line 2"),
        (SMALL, "conjunction: Minimum", "conjunction: Minimum\n  range: 0 1", "line 10: RuleBlock has no range"),
        (SMALL, "OutputVariable: z", "InputVariable: x\n  range: 0 1\nOutputVariable: z", "line 4: x is declared"),
        (
            SMALL,
            "  term: low",
            "".join(f"  term: t{n} Ramp 0 1\n" for n in range(16)) + "  term: low",
            "line 19: more than",
        ),
        (SMALL, "  rule:", "  rule: if x is low then z is one\n" * 32 + "  rule:", "line 42: more than 32 rules"),
        (SMALL, "Ramp 6 0", "Discrete" + " 0 1" * 65, "130 numbers; at most 128"),
        (SMALL, "Ramp 6 0", "Ramp 6 ٠", "line 3: '٠' is not a number"),
        (SMALL, "Ramp 6 0", "GaussianProduct 1 2 3 0", "term low: GaussianProduct has a width of 0"),
        (SMALL, "range: 0 6", "range: -inf 6", "line 1: x: range is -inf to 6.0; give two finite"),
        (SMALL, "  term: low Ramp 6 0\n", "", "line 1: x has no term; add one, or leave the input out"),
        (SMALL, "range: 0 6", "enabled: false", "line 2: enabled is false, which is not supported"),
        (SMALL, "range: 0 6", "lock-range: true", "line 2: lock-range is true, which is not supported"),
        (
            SMALL,
            "  term: one",
            "  lock-previous: true\n  term: one",
            "line 7: lock-previous is true, but hardware keeps no",
        ),
        (SMALL, "Constant 1", "Constant 1 2", "line 7: term 'one Constant 1 2': an output of order zero has"),
        (SMALL, "  rule: if x is low then z is one\n", "", "a system needs at least one input and one rule"),
        (SMALL, "x is low then", "x was low then", "'x was low' is not a condition of another input"),
        (SMALL, "x is low then", "x is low and x is low then", "'x is low' is not a condition of another input"),
        (SMALL, "x is low then", "(x is low or x is low) then", "'or' with parentheses is not supported"),
        (SMALL, "if x", "when x", "line 10: rule 'when x is low then z is one' is not of the form"),
        (
            SMALL,
            "z is one",
            "z is one then z is one",
            "then z is one' is not of the form: if A is x and B is y then z is",
        ),
        (SMALL, "z is one", "z is one and z is one", "what follows 'then' is not: z is CONSTANT"),
    ],
)
def test_fll_is_read_strictly(tmp_path: Path, text: str, old: str, new: str, says: str) -> None:
    assert read_fll(text).rules
    assert old in text
    path = tmp_path / "rules.fll"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=r"rules\.fll") as caught:
        load_system(path)
    assert says in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


def test_more_inputs_than_are_supported_are_refused() -> None:
    inputs = "".join(f"InputVariable: x{n}\n  range: 0 6\n  term: low Ramp 6 0\n" for n in range(6))
    with pytest.raises(ValueError, match="has 6 inputs"):
        read_fll(inputs + SMALL[SMALL.index("OutputVariable") :].replace("if x is", "if x0 is"))


def test_names_are_no_markup(tmp_path: Path) -> None:
    path = tmp_path / "rules.fll"
    marked = SMALL.replace("x", "x[/y]").replace("low", "low[/b]")
    # Windows' editors begin a file with a mark.
    path.write_text("Engine: [red]a[/blue]\x1b[31m\n" + marked, encoding="utf-8-sig")
    result = CliRunner().invoke(app, ["fuzzy", str(path)])
    assert result.exception is None
    assert "low[/b]" in result.output
    assert "x[/y]" in result.output
    assert "\x1b" not in result.output


TIP = """Engine: tip
InputVariable: service
  range: 0 10
  term: poor Gaussian 0 1.5
  term: average Gaussian 5 1.5
  term: good Gaussian 10 1.5
InputVariable: food
  range: 0 10
  term: rancid Trapezoid -inf 0 1 3
  term: delicious Trapezoid 7 9 10 15
OutputVariable: other
  range: 0 1
  defuzzifier: WeightedAverage
  default: nan
  term: one Function service / food
OutputVariable: match
  range: 0 30
  defuzzifier: WeightedAverage
  default: nan
  term: cheap Linear 0 0 5
  term: average Constant 15
  term: generous Linear 0 0 25
RuleBlock: rules
  conjunction: none
  disjunction: Maximum
  activation: General
  rule: if service is poor or food is rancid or service is average then match is cheap
  rule: if service is average then other is one and match is average
  rule: if service is good or food is delicious then match is generous
  rule: if service is good then other is one
"""


@pytest.mark.parametrize("disjunction", ["Maximum", "UnboundedSum"])
def test_or_and_one_of_several_outputs_give_what_fuzzylite_gives(disjunction: str) -> None:
    text = TIP.replace("Maximum", disjunction)
    system = read_fll(text)
    assert system.conjunction == "minimum"
    assert len(system.rules) == 6
    grid = [axis.ravel() for axis in np.meshgrid(np.linspace(0, 10, 33), np.linspace(0, 10, 33))]
    # Its own functions need more than a number: only the output that is asked for is compared.
    theirs = evaluate_by_fuzzylite(text.replace("Function service / food", "Constant 1"), grid, output=1)
    np.testing.assert_allclose(system.evaluate(*grid), theirs, atol=1e-12)
    assert measure_errors(quantise(system, 33)).firm < 0.01


def test_which_of_several_outputs_is_asked_for() -> None:
    named = TIP.replace("match", "tip")
    with pytest.raises(ValueError, match="has 2 outputs, other, tip; choose one, or name one match"):
        read_fll(named)
    with pytest.raises(ValueError, match="has no output price; there are other, tip"):
        read_fll(named, "price")
    assert read_fll(named, "tip").output.name == "tip"
    with pytest.raises(ValueError, match=r"line 29: .* what follows 'then' is not: tip is CONSTANT"):
        read_fll(named.replace("then tip is generous", "then tap is generous"), "tip")
    with pytest.raises(ValueError, match=r"line 30: .* what follows 'then' is not: tip is CONSTANT"):
        read_fll(named.replace("good then other is one", "good then tap is one and other is one"), "tip")
