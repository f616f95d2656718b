"""The pictures of fuzzy systems, held pixel by pixel against the rules in real numbers."""

from typing import Any

import cv2
import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from golden_model.arrays import Array, Pixels
from golden_model.fuzzy.fll import load_system
from golden_model.fuzzy.rules import SHIPPED
from skymosaic.fuzzy import plots
from skymosaic.fuzzy.plots import SET_COLORS, draw_system
from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS
from skymosaic.fuzzy.quantised import MIN_FIRING_STRENGTH

QUICK = ("aerial-turn", "ransac")


def nearest_colours(picture: Pixels, plot: Axes, places: Array, colours: Array) -> Array:
    """How far, of 255 levels, the picture is from the colours (N, 3) within two pixels of places (N, 2) of a plot."""
    x, from_below = np.rint(plot.transData.transform(places)).astype(int).T
    y = len(picture) - from_below
    reach = range(-2, 3)
    around = np.stack([picture[y + row, x + column] for row in reach for column in reach]).astype(float)
    return np.asarray(np.abs(around - 255 * colours).max(axis=2).min(axis=0))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in PLOTTED_SYSTEMS]
)
def test_curves_and_surfaces_are_those_of_the_rules(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Figure] = []

    def make_figure(**options: Any) -> Figure:
        made.append(Figure(**options))
        return made[-1]

    monkeypatch.setattr(plots, "Figure", make_figure)
    plotted, truth = PLOTTED_SYSTEMS[name], load_system(SHIPPED / f"{name}.fll")
    decoded: Any = cv2.imdecode(np.frombuffer(draw_system(plotted), np.uint8), cv2.IMREAD_COLOR_RGB)
    picture = np.asarray(decoded, np.uint8)
    axes = made[0].axes
    title = picture[: len(picture) // 20]
    assert title.min() < 50
    assert title[:, [0, -1]].min() == 255, "the title is cut off"
    for plot, variable in zip(axes, truth.inputs, strict=False):
        last = plot.lines[0].get_xdata().max()
        whole = plot.lines[0].get_marker() == "o"
        x = np.arange(variable.low, last + 1) if whole else np.linspace(variable.low, min(variable.high, last), 30)
        degrees = [term.degree(x) for term in variable.terms.values()]
        for degree, colour in zip(degrees, SET_COLORS, strict=False):
            # Where curves meet, one hides the other.
            alone = sum(np.abs(degree - other) < 0.1 for other in degrees) == 1
            places = np.stack((x, degree), axis=1)[alone]
            far = nearest_colours(picture, plot, places, np.tile(to_rgb(colour), (len(places), 1)))
            assert np.mean(far < 40) > 0.9
    first, second = plotted.surface
    for plot, (_, entry) in zip(axes[len(truth.inputs) :], plotted.sections, strict=False):
        (left, right), (low, high) = plot.get_xlim(), plot.get_ylim()
        x, y = (
            each.ravel() for each in np.meshgrid(np.linspace(left, right, 17)[1:-1], np.linspace(low, high, 14)[1:-1])
        )
        values = [axis.units(np.full(x.size, entry)) for axis in plotted.axes]
        values[first], values[second] = x, y
        # Where hardly any rule fires, integers and real numbers differ.
        firm = truth.strengths(*values).sum(axis=1) >= MIN_FIRING_STRENGTH
        places, colours = np.stack((x, y), axis=1), colormaps["viridis"](truth.evaluate(*values))[:, :3]
        assert np.mean(nearest_colours(picture, plot, places[firm], colours[firm]) < 40) > 0.9
