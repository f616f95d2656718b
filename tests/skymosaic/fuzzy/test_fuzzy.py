"""The integer model of a system from a file, and what is plotted of it."""

import numpy as np
import pytest

from golden_model.fuzzy.fll import load_system, read_fll
from golden_model.fuzzy.rules import SHIPPED
from golden_model.fuzzy.sugeno import ONE
from golden_model.fuzzy.system import FuzzySystem, IfThen, Input, Output
from golden_model.fuzzy.terms import Term
from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS, plan_plot
from skymosaic.fuzzy.quantised import measure_errors, quantise
from tests.golden_model.fuzzy.valve import VALVE


@pytest.mark.parametrize(("name", "entries"), [("correlation", 64), ("ilbp", 17), ("ransac", 17), ("ransac", 64)])
def test_the_errors_stay_within_the_bound(name: str, entries: int) -> None:
    quantised = quantise(load_system(SHIPPED / f"{name}.fll"), entries)
    rng = np.random.default_rng(2)
    indices = rng.integers(0, entries, (len(quantised.real.inputs), 5000))
    values = [quantised.positions(v)[index] for v, index in zip(quantised.real.inputs, indices, strict=True)]
    total = quantised.real.strengths(*values).sum(axis=1)
    fires = quantised.model.strengths(*indices).sum(axis=1) > 0
    difference = np.abs(quantised.evaluate(*indices)[fires] - quantised.real.evaluate(*values)[fires])
    bound = (len(quantised.real.rules) / np.maximum(total[fires], 1e-9) + 2) / 512
    assert (difference <= bound).all()
    errors = measure_errors(quantised)
    assert errors.largest >= difference.max() - 1e-12
    assert errors.mean <= errors.firm <= errors.largest
    assert errors.complete == (entries ** len(quantised.real.inputs) <= 1 << 18)


def test_degrees_are_rounded_to_the_nearest_and_terms_that_sum_to_one_still_do() -> None:
    for name, largest in (("correlation", 0.5), ("ilbp", 1.0)):
        quantised = quantise(load_system(SHIPPED / f"{name}.fll"), 61)
        for variable, tables in zip(quantised.real.inputs, quantised.model.inputs, strict=True):
            for term in variable.terms.values():
                exact = term.degree(quantised.positions(variable)) * ONE
                assert np.abs(tables.sets[term.name] - exact).max() <= largest + 1e-9
            if name == "ilbp":
                assert (sum(tables.sets.values()) == ONE).all()


def corners(*slopes: tuple[float, float]) -> FuzzySystem:
    """Four rules of a product over two inputs with two terms each that sum to one only if the slopes are opposite."""
    inputs = tuple(
        Input(name, 0.0, 1.0, {"low": Term("low", "Ramp", slopes[0]), "high": Term("high", "Ramp", slopes[1])})
        for name in ("x", "y")
    )
    rules = tuple(IfThen({"x": x, "y": y}, f"{x}_{y}") for x in ("low", "high") for y in ("low", "high"))
    constants = {"low_low": 0.0, "low_high": 10.0, "high_low": 20.0, "high_high": 40.0}
    return FuzzySystem("corners", inputs, Output("z", 0.0, 40.0, constants), rules, "product")


def test_a_product_of_terms_that_sum_to_one_needs_no_division() -> None:
    errors = measure_errors(quantise(corners((1.0, 0.0), (0.0, 1.0)), 100))
    assert errors.complete
    assert errors.largest < 3 / 256
    with pytest.raises(ValueError, match="strengths sum to"):
        quantise(corners((1.0, 0.0), (0.0, 0.5)), 100)


@pytest.mark.parametrize("name", PLOTTED_SYSTEMS)
def test_each_plot_fits_its_system(name: str) -> None:
    plotted = PLOTTED_SYSTEMS[name]
    inputs = len(plotted.system().inputs)
    assert len(plotted.axes) == inputs
    assert set(plotted.surface) <= set(range(inputs))
    assert (len(plotted.sections) > 1) == (inputs > 2)


def test_a_third_input_is_shown_at_its_ends_and_in_its_middle() -> None:
    flow = "InputVariable: flow\n  range: 2 12\n  term: some Rectangle 2 12\nOutputVariable"
    three = VALVE.replace("OutputVariable", flow).replace("pressure is low", "pressure is low and flow is some")
    plotted = plan_plot(quantise(read_fll(three), 41))
    assert plotted.sections == (("flow 2", 0), ("flow 7", 20), ("flow 12", 40))
    assert (plotted.surface, plotted.span, plotted.title) == ((0, 1), (-100, 100), "valve")
    text = VALVE.replace("Engine: valve\n", "Engine: valve\n  description: How far it opens.\n", 1)
    assert plan_plot(quantise(read_fll(text), 41)).title == "How far it opens."
    two = plan_plot(quantise(read_fll(VALVE), 41))
    assert two.sections == (("", 0),)
    for axis, low, high in zip(two.axes, (3, 55), (27, 95), strict=True):
        assert axis.units(np.array([0, 40])).tolist() == [low, high]
