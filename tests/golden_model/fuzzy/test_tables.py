"""Tables of the integer model, made of terms in real numbers."""

import numpy as np
import pytest

from golden_model.fuzzy.system import FuzzySystem, IfThen, Input, Output
from golden_model.fuzzy.tables import make_tables
from golden_model.fuzzy.terms import Term

HALF_STEP = 1 / 512
"""Largest error of a degree that is rounded to 8 fraction bits."""
INDEX = np.arange(50)


def table(shape: str, *parameters: float, entries: int = 50, trimmed: bool = False) -> np.ndarray:
    """The table of one term, in units of the index."""
    variable = Input("x", 0.0, 49.0, {"a": Term("a", shape, parameters)})
    system = FuzzySystem("s", (variable,), Output("z", 0.0, 1.0, {"c": 1.0}), (IfThen({"x": "a"}, "c"),), "minimum")
    return make_tables(system, [np.arange(float(entries))], trimmed=trimmed).inputs[0].sets["a"]


@pytest.mark.parametrize(("zero_at", "one_at"), [(4.5, 20.25), (20.25, 4.5)])
def test_ramp_is_within_half_a_step_of_the_line(zero_at: float, one_at: float) -> None:
    line = np.interp(INDEX, [4.5, 20.25], [float(zero_at > one_at), float(zero_at < one_at)])
    assert np.abs(table("Ramp", zero_at, one_at) / 256 - line).max() <= HALF_STEP


def test_trapezoid_and_sigmoid_are_within_half_a_step() -> None:
    expected = np.interp(INDEX, [3, 10, 20, 41], [0, 1, 1, 0])
    assert np.abs(table("Trapezoid", 3, 10, 20, 41) / 256 - expected).max() <= HALF_STEP
    assert np.abs(table("Sigmoid", 20, -0.3) / 256 - 1 / (1 + np.exp(0.3 * (INDEX - 20)))).max() <= HALF_STEP


def test_a_trimmed_table_ends_where_it_no_longer_changes() -> None:
    assert len(table("Ramp", 3, 9)) == 50
    assert table("Ramp", 3, 9, trimmed=True).tolist() == [0, 0, 0, 0, 43, 85, 128, 171, 213, 256]
    assert table("Ramp", 60, 59, trimmed=True).tolist() == [256]
