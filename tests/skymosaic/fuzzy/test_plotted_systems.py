import pytest

from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS


@pytest.mark.parametrize("name", PLOTTED_SYSTEMS)
def test_each_plot_fits_its_system(name: str) -> None:
    plotted = PLOTTED_SYSTEMS[name]
    inputs = len(plotted.system().inputs)
    assert len(plotted.axes) == inputs
    assert set(plotted.surface) <= set(range(inputs))
    assert (len(plotted.sections) > 1) == (inputs > 2)
