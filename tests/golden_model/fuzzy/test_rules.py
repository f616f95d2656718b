"""Rules for matches in FLL: the shipped ones decide as the published formulas do, bad ones are named by their line."""

import itertools
import math
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from golden_model.config import Config, MatcherConfig
from golden_model.config_file import load_config, to_toml
from golden_model.feature.ilbp import PATTERNS
from golden_model.formats import POSITION
from golden_model.fuzzy.fll import load_system
from golden_model.fuzzy.rules import SHIPPED, MatchRules, load_rules, match_tables, read_shipped
from golden_model.fuzzy.sugeno import ONE, SugenoSystem
from golden_model.fuzzy.system import make_tables
from skymosaic.geometry import fuzzy_ransac

AERIAL = read_shipped("aerial")
ALL_BITS = sorted({pattern.bits for pattern in PATTERNS.values()})


def rounded(degree: Fraction | float) -> int:
    return math.floor(degree * ONE + Fraction(1, 2))


def ramp(value: Fraction, zero_at: str, one_at: str) -> int:
    low, high = Fraction(zero_at), Fraction(one_at)
    return rounded(min(max((value - low) / (high - low), Fraction(0)), Fraction(1)))


def assert_tables(system: SugenoSystem, number: int, name: str, other: str, expected: list[int]) -> None:
    """One set has these degrees, beyond its end the last, and the other one their complement."""
    sets = system.inputs[number].sets
    entries = np.minimum(np.arange(len(expected)), system.inputs[number].entries - 1)
    np.testing.assert_array_equal(sets[name][entries], expected)
    np.testing.assert_array_equal(sets[other][entries], ONE - np.array(expected))


@pytest.mark.parametrize("bits", ALL_BITS)
def test_aerial_is_the_published_formula_over_the_whole_grid(bits: int) -> None:
    """In exact fractions: low is clip((.34 - d) / .24), big clip(m / .10), common 1, 1, .6, .2, 0."""
    system = match_tables(AERIAL, bits)
    shares = [Fraction(n, bits) for n in range(bits + 1)]
    assert_tables(system, 0, "low", "high", [ramp(share, "0.34", "0.1") for share in shares])
    assert_tables(system, 1, "big", "small", [ramp(share, "0", "0.1") for share in shares])
    assert_tables(system, 2, "common", "other", [256, 256, 154, 51, 0, 0, 0, 0, 0])
    outputs = ("1", "0.15", "0.6", "0.05", "0.6", "0.02", "0.2", "0")
    sets = itertools.product(("low", "high"), ("big", "small"), ("common", "other"))
    expected = [(chosen, rounded(Fraction(output))) for chosen, output in zip(sets, outputs, strict=True)]
    assert [(rule.sets, rule.singleton) for rule in system.rules] == expected
    assert system.conjunction == "product"


@pytest.mark.parametrize("bits", ALL_BITS)
def test_ilbp_is_the_published_formula_over_the_whole_grid(bits: int) -> None:
    system = match_tables(read_shipped("ilbp"), bits)
    slope = 2 * math.log(19) / (9 * (13 - 6))
    assert_tables(system, 0, "low", "high", [ramp(Fraction(n, bits), "0.375", "0.125") for n in range(bits + 1)])
    belongs = [rounded(1 / (1 + math.exp(slope * (sad - 85.5)))) for sad in range(181)]
    assert belongs[153] == 0
    for number in (1, 2):
        assert_tables(system, number, "belongs", "does_not", belongs)


def test_the_file_of_fuzzy_ransac_decides_as_the_built_in_does() -> None:
    """At every input: the check, and errors in 1/16 px up to 8 px."""
    system = load_system(SHIPPED / "ransac.fll")
    steps = np.arange(8 * POSITION.one + 1)
    tables = make_tables(system, [np.array([0.0, 1.0]), steps / POSITION.one], trimmed=True)
    check, error = (axis.ravel() for axis in np.meshgrid([0, 1], steps, indexing="ij"))
    for found, expected in zip(
        tables.evaluate(check, error), fuzzy_ransac.rule_base().evaluate(check, error), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


def changed(old: str, new: str, count: int = 1) -> str:
    assert old in AERIAL
    return AERIAL.replace(old, new, count)


WITHOUT_LAST = AERIAL[: AERIAL.rindex("  rule:")].replace("AlgebraicProduct", "Minimum")
BAD: dict[str, tuple[str, str]] = {
    "a rule without output": (changed(" then weight is sure", ""), "line 45: rule"),
    "an output that does not exist": (changed("weight is sure", "weight is certain"), "line 45: rule 1: weight has no"),
    "a gap in an input": (
        changed("low Ramp 0.34 0.1", "low Ramp 0.08 0.05").replace("AlgebraicProduct", "Minimum"),
        "line 3: no term of distance covers 0.08203 to 0.09766",
    ),
    "a gap between rules": (WITHOUT_LAST, "line 51: no rule fires at distance 0.3398, margin 0, orientation 4"),
    "a default that is not 0": (changed("default: nan", "default: 0.5"), "line 24: the default is 0.5"),
    "strengths that do not sum to one": (
        changed("high Ramp 0.1 0.34", "high Ramp 0.1 0.4"),
        "line 45: aerial: strengths sum to",
    ),
    "an output that is not a number": (changed("sure Constant 1", "sure Constant nan"), "line 32: term sure is nan"),
    "an output above 1": (changed("sure Constant 1", "sure Constant 1.5"), "line 32: term sure is 1.5, outside of"),
    "another range": (changed("range: 0 1", "range: 0 128"), "line 3: the range of distance is 0 to 128; it must be"),
    "another output's range": (
        changed("  range: 0 1\n  lock-range: false\n  aggregation", "  range: 0 2\n  lock-range: false\n  aggregation"),
        "line 24: the range of weight is 0 to 2",
    ),
    "other inputs": (read_shipped("correlation"), "line 17: the inputs are SAD, ZSSD, NCC; those of a match are"),
    "a term that is no identifier": (AERIAL.replace("low", "1ow"), "line 8: '1ow' is no Verilog identifier"),
    "an input with a minus": (AERIAL.replace("weight", "w-eight"), "line 24: 'w-eight' is no Verilog identifier"),
    "too many rules": (AERIAL + AERIAL[AERIAL.rindex("  rule:") :] * 100_000, "line 77: more than 32 rules"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_rules_are_one_line_with_file_and_line(tmp_path: Path, what: str) -> None:
    text, says = BAD[what]
    path = tmp_path / "my.fll"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"my\.fll") as caught:
        load_rules(path)
    assert str(caught.value).startswith(f"{path}: {says}")
    assert "\n" not in str(caught.value)


def test_rules_have_the_name_in_their_text_or_that_of_their_file(tmp_path: Path) -> None:
    path = tmp_path / "my.fll"
    for text, name in ((AERIAL, "aerial"), (changed("Engine: aerial", "Engine:"), "my")):
        path.write_text(text)
        assert load_rules(path).name == name


def test_where_no_rule_fires_a_default_of_0_rejects() -> None:
    rules = MatchRules(WITHOUT_LAST.replace("default: nan", "default: 0"))
    weight, rule = rules.tables(128).evaluate(np.array([128]), np.array([0]), np.array([8]))
    assert (weight.item(), rule.item()) == (0, 0)


@pytest.mark.parametrize(
    ("change", "same"),
    [
        (lambda text: text.replace("low", "near").replace("# ", ""), True),
        (lambda text: text.replace("sure Constant 1", "sure Constant 0.999"), True),
        (lambda text: text.replace("sure Constant 1", "sure Constant 0.99"), False),
        (
            lambda text: text.replace("Ramp 0 0.1", "Ramp 0 0.11").replace("small Ramp 0.1 0", "small Ramp 0.11 0"),
            False,
        ),
        (lambda text: text.replace("AlgebraicProduct", "Minimum"), False),
        (lambda text: text.replace("weight is never", "weight is hardly"), False),
    ],
)
def test_the_digest_tells_decisions_apart_and_not_names(change: Callable[[str], str], same: bool) -> None:
    digest, other = (MatchRules(text).tables(128).digest for text in (AERIAL, change(AERIAL)))
    assert change(AERIAL) != AERIAL
    assert (digest == other) == same


def test_a_configuration_holds_rules_or_names_their_file(tmp_path: Path) -> None:
    text = changed("description: The rules", 'description: "\\ \x1f """ rules')
    config = Config(matcher=MatcherConfig(rule_base=MatchRules(text)))
    path = tmp_path / "a.toml"
    path.write_text(to_toml(config))
    assert load_config(path) == config
    (tmp_path / "own.fll").write_text(text)
    path.write_text('[matcher]\nrule_base = "own.fll"\n')
    assert load_config(path) == config
    path.write_text('[matcher]\nrule_base = "absent.fll"\n')
    with pytest.raises(ValueError, match=r"absent\.fll: cannot be read"):
        load_config(path)
