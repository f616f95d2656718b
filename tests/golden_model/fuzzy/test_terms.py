"""Degrees of membership against FuzzyLite's own terms, and which parameters are refused."""

import math

import numpy as np
import pytest

from golden_model.fuzzy.terms import Term

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
]


@pytest.mark.parametrize(("shape", "parameters"), TERMS)
def test_degrees_are_those_of_fuzzylite(shape: str, parameters: tuple[float, ...]) -> None:
    theirs = getattr(fuzzylite, shape)("term")
    theirs.configure(" ".join(map(str, parameters)))
    x = np.concatenate((np.linspace(-4, 5, 181), [each for each in parameters if math.isfinite(each)]))
    expected = [theirs.membership(float(each)) for each in x]
    np.testing.assert_allclose(Term("term", shape, parameters).degree(x), expected, atol=1e-12)


def test_a_vertical_edge_belongs_to_its_upper_end() -> None:
    term = Term("steps", "Discrete", (0.0, 0.25, 1.0, 0.25, 1.0, 1.0, 2.0, 1.0, 2.0, 0.5, 3.0, 0.0))
    assert term.degree(np.array([0.5, 1.0, 1.5, 2.0, 2.5, 4.0])).tolist() == [0.25, 1.0, 1.0, 1.0, 0.25, 0.0]


def test_a_steep_sigmoid_is_a_step_and_overflows_nowhere() -> None:
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
    ],
)
def test_wrong_parameters_are_refused(shape: str, parameters: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=f"term low: .*{message}"):
        Term("low", shape, parameters)
