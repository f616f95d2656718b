"""MATLAB's files against MATLAB's own formulas of their shapes, and against what FuzzyLite makes of the same system."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from golden_model.config import Config, MatcherConfig
from golden_model.config_file import load_config, to_toml
from golden_model.fuzzy.fis import SHAPES, to_fll
from golden_model.fuzzy.fll import load_system, read_fll
from golden_model.fuzzy.rules import load_rules
from tests.golden_model.fuzzy.test_fll import draw_inputs, evaluate_by_fuzzylite
from tests.golden_model.fuzzy.tipper import TIPPER


def sigmf(x: float, a: float, c: float) -> float:
    return 1 / (1 + np.exp(-a * (x - c)))


def smf(x: float, a: float, b: float) -> float:
    if x <= (a + b) / 2:
        return 0.0 if x <= a else 2 * ((x - a) / (b - a)) ** 2
    return 1.0 if x >= b else 1 - 2 * ((x - b) / (b - a)) ** 2


def gaussmf(x: Any, s: float, c: float) -> Any:
    return np.exp(-((x - c) ** 2) / (2 * s**2))


MATLAB: dict[str, tuple[str, Callable[[float], float]]] = {
    "trimf": ("1 4 6", lambda x: max(min((x - 1) / 3, (6 - x) / 2), 0)),
    "trapmf": ("1, 3, 5, 9", lambda x: max(min((x - 1) / 2, 1, (9 - x) / 4), 0)),
    "linsmf": ("2 7", lambda x: min(max((x - 2) / 5, 0), 1)),
    "linzmf": ("2 7", lambda x: min(max((7 - x) / 5, 0), 1)),
    "smf": ("1 8", lambda x: smf(x, 1, 8)),
    "zmf": ("3 7 0 0", lambda x: 1 - smf(x, 3, 7)),
    "pimf": ("1 4 5 9.5", lambda x: smf(x, 1, 4) * (1 - smf(x, 5, 9.5))),
    "gaussmf": ("2 5 0 0", lambda x: gaussmf(x, 2, 5)),
    "gauss2mf": ("2 4 1 8", lambda x: gaussmf(min(x, 4), 2, 4) * gaussmf(max(x, 8), 1, 8)),
    "gbellmf": ("2 4 6 0", lambda x: 1 / (1 + abs((x - 6) / 2) ** 8)),
    "sigmf": ("2 4", lambda x: sigmf(x, 2, 4)),
    "dsigmf": ("5 2 3 7", lambda x: abs(sigmf(x, 5, 2) - sigmf(x, 3, 7))),
    "psigmf": ("2 3 -5 8", lambda x: sigmf(x, 2, 3) * sigmf(x, -5, 8)),
}


@pytest.mark.parametrize("shape", MATLAB)
def test_each_shape_is_what_matlab_computes(shape: str) -> None:
    numbers, degree = MATLAB[shape]
    system = read_fll(to_fll(TIPPER.replace("'gaussmf',[1.5 10]", f"'{shape}',[{numbers}]")))
    x = np.linspace(0, 10, 101)
    np.testing.assert_allclose(system.inputs[0].terms["very_good"].degree(x), list(map(degree, x)), atol=1e-12)


def test_every_shape_has_its_formula() -> None:
    assert {*MATLAB, "constant", "linear"} == SHAPES.keys()


@pytest.mark.parametrize("method", ["min", "prod"])
def test_a_system_computes_what_matlab_computes(method: str) -> None:
    # OR needs the minimum here.
    text = TIPPER.replace("'min'", f"'{method}'")
    text = text if method == "min" else text.replace("(1) : 2", "(1) : 1")
    system = read_fll(to_fll(text))
    values = draw_inputs(system)
    service, food = values
    poor, good = np.clip((10 - service) / 10, 0, 1), gaussmf(service, 1.5, 10)
    bad, nice = np.clip((8 - food) / 6, 0, 1), np.clip((food - 2) / 6, 0, 1)
    first = np.maximum(poor, bad) if method == "min" else poor * bad
    both = np.minimum(good, nice) if method == "min" else good * nice
    expected = (5 * first + 15 * good + 25 * both) / (first + good + both)
    np.testing.assert_allclose(system.evaluate(*values), expected, atol=1e-12)
    np.testing.assert_allclose(evaluate_by_fuzzylite(to_fll(text), values), expected, atol=2e-3)


def test_blanks_comments_and_counted_rules_change_nothing() -> None:
    spaced = TIPPER.replace("=", " = ").replace("':'", "' : '").replace("',[", "' , [").replace("\nMF", "\n\n  MF")
    spaced = "# by another program\n% and this\n" + spaced.replace("1 1, 1 (1)", "1.000 1.000 , 1.000 (1.000)")
    # Not a number, the default, equals nothing.
    read, expected = (re.sub(r"\n+", "\n", to_fll(text)) for text in (spaced, TIPPER))
    assert read == expected
    assert read_fll(read).rules


def test_one_of_several_outputs_is_computed() -> None:
    other = TIPPER[TIPPER.index("[Output1]") : TIPPER.index("[Rules]")].replace("1]", "2]", 1).replace("tip", "match")
    text = TIPPER.replace("[Rules]", f"{other}[Rules]").replace("NumOutputs=1", "NumOutputs=2")
    text = re.sub(r", (\d) \(", r", \1 0 (", text, count=2)
    system = read_fll(to_fll(text.replace(", 3 (1)", ", 0 3 (1)")))
    assert (system.output.name, [rule.conclusion for rule in system.rules]) == ("match", ["high"])


WRONG = {
    "mamdani": ("'sugeno'", "'mamdani'", "line 3: Type is mamdani; sugeno is supported"),
    "weighted sum": ("wtaver", "wtsum", "line 12: DefuzzMethod is wtsum; wtaver is supported"),
    "without a type": ("Type='sugeno'", "", "Type is missing; sugeno is supported"),
    "slopes": ("[0 0 15]", "[0 1 15]", "line 33: term 'mid Linear 0 1 15': an output of order zero has terms of the"),
    "another shape": ("'trimf'", "'mymf'", "line 18: 'poor':'mymf',[-10 0 10] is not of the form 'NAME':'SHAPE'"),
    "too many numbers": ("[-10 0 10]", "[-10 0 10 11]", "line 18: term poor: Triangle takes 3 numbers, not 4"),
    "too few numbers": ("[1.5 10]", "[1.5]", "line 19: term very_good: Gaussian takes 2 numbers, not 1"),
    "no number": ("[1.5 10]", "[1.5 x]", "line 19: could not convert string to float: 'x'"),
    "out of the range": ("[25]", "[31]", "line 34: term high is 31, outside of the range 0 to 30"),
    "NOT": ("2 2, 3", "-2 2, 3", "line 39: -2 is a term with NOT or a hedge; terms stand alone here"),
    "hedge": ("2 2, 3", "2.2 2, 3", "line 39: 2.2 is a term with NOT or a hedge"),
    "no such term": ("2 2, 3", "2 3, 3", "line 39: food has no MF3"),
    "a number less": ("2 2, 3", "2, 3", "line 39: a rule has 1 numbers for 2 inputs"),
    "weight": ("3 (1)", "3 (0.5)", "line 39: rule '2 2, 3 (0.5) : 1' has a weight of 0.5; 1 is supported"),
    "other disjunction": ("'max'", "'probor'", "line 37 needs OR, and line 36: disjunction is probor; valid: Maximum"),
    "other conjunction": ("'min'", "'hamacher'", "conjunction is hamacher; valid: Minimum"),
    "unknown key": ("Version=2.0", "Verse=2.0", "line 4: 'Verse=2.0' is not known in a .fis file"),
    "unknown section": ("[Input2]", "[Entry2]", "line 22: \"Name='food'\" is not known in a .fis file"),
    "without headings": ("[System]", "", "line 2: \"Name='tipper'\" is not known in a .fis file"),
    "a rule that is lost": ("2 0, 2 (1) : 1\n", "", "NumRules is 3; 2 are there; is the file cut off?"),
    "an input that is lost": ("NumInputs=2", "NumInputs=3", "NumInputs is 3; 2 are there; is the file cut off?"),
    "an input without terms": (
        """MF1='bad':'trapmf',[0 0 2 8]\nMF2='nice':'trapmf',[2 8 10 10]\n""",
        "",
        "food has no MF1",
    ),
    "FLL": (TIPPER, "Engine: valve\n", "line 1: 'Engine: valve' is not known in a .fis file"),
    "nothing": (TIPPER, "", "Type is missing; sugeno is supported"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_file_is_one_line_that_names_it(tmp_path: Path, name: str) -> None:
    old, new, message = WRONG[name]
    assert old in TIPPER
    path = tmp_path / "wrong.fis"
    path.write_text(TIPPER.replace(old, new, 1))
    with pytest.raises(ValueError, match=r"wrong\.fis: ") as refused:
        load_system(path)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_cut_off_anywhere_is_refused() -> None:
    # From here on only blanks, and the connection of a rule with one condition are missing.
    for end in range(TIPPER.rindex("1")):
        with pytest.raises(ValueError, match=r"."):
            read_fll(to_fll(TIPPER[:end]))


def test_rules_for_matches_come_from_matlab_too(tmp_path: Path) -> None:
    (tmp_path / "own.fis").write_text(MATCH_RULES)
    rules = load_rules(tmp_path / "own.fis")
    path = tmp_path / "own.toml"
    path.write_text('[matcher]\nrule_base = "own.fis"\n')
    assert load_config(path) == Config(matcher=MatcherConfig(rule_base=rules))
    path.write_text(to_toml(load_config(path)))
    assert load_config(path) == Config(matcher=MatcherConfig(rule_base=rules))
    weights, _ = rules.tables(128).evaluate(*np.array([[0, 0, 0], [128, 0, 0], [64, 0, 0]]).T)
    assert weights.tolist() == [255, 0, 128]


MATCH_RULES = """\
[System]
Name='own'
Type='sugeno'
NumInputs=3
NumOutputs=1
NumRules=2
AndMethod='min'
DefuzzMethod='wtaver'
[Input1]
Name='distance'
Range=[0 1]
NumMFs=2
MF1='low':'linzmf',[0 1]
MF2='high':'linsmf',[0 1]
[Input2]
Name='margin'
Range=[0 1]
NumMFs=1
MF1='any size':'trapmf',[0 0 1 1]
[Input3]
Name='orientation'
Range=[0 8]
NumMFs=1
MF1='any angle':'trapmf',[0 0 8 8]
[Output1]
Name='weight'
Range=[0 1]
NumMFs=2
MF1='never':'constant',[0]
MF2='sure':'constant',[1]
[Rules]
1 0 0, 2 (1) : 1
2 0 0, 1 (1) : 1
"""
