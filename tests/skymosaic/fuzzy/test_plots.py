from dataclasses import replace

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from skymosaic.fuzzy.plots import _plot_membership, draw_system
from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS

QUICK = ("aerial-turn", "ransac")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in PLOTTED_SYSTEMS]
)
def test_each_system_has_a_picture_with_curves_and_surface(name: str) -> None:
    decoded = cv2.imdecode(np.frombuffer(draw_system(PLOTTED_SYSTEMS[name]), np.uint8), cv2.IMREAD_COLOR)
    height, width = decoded.shape[:2]
    assert min(height, width) > 600
    assert len(np.unique(decoded.reshape(-1, 3), axis=0)) > 50


def test_each_of_sixteen_sets_has_a_curve_of_its_own_colour() -> None:
    plotted = PLOTTED_SYSTEMS["aerial"]
    variable = plotted.system().inputs[0]
    table = next(iter(variable.sets.values()))
    plot = Figure().subplots()
    _plot_membership(plot, replace(variable, sets={f"set {n}": table for n in range(16)}), plotted.axes[0])
    assert len({str(line.get_color()) for line in plot.lines}) == 16
