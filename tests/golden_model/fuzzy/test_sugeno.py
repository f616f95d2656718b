"""Membership tables, rules and Sugeno systems in fixed point; `test_rule_bases` has the matcher's own systems."""

from typing import Any

import numpy as np
import pytest

from golden_model.fuzzy.sugeno import Rule, SugenoSystem, Variable
from golden_model.matching.rule_bases import aerial


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
        (
            {"rules": (Rule(("s0",), 1.0, joins=True),), "conjunction": "minimum"},
            "rule 0: OR needs",
        ),
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
