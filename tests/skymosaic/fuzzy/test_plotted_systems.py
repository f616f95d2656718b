import numpy as np
import pytest

from golden_model.fuzzy.fll import read_fll
from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS, plan_plot
from skymosaic.fuzzy.quantised import quantise
from tests.golden_model.fuzzy.valve import VALVE


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
