"""Plots of the fuzzy systems: the membership curves of every input and the rule surface.

Needs matplotlib, which the extra ``plots`` installs.
"""

import io

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from numpy.typing import NDArray

from golden_model.formats import WEIGHT
from golden_model.fuzzy.sugeno import ONE, SugenoSystem, Variable
from skymosaic.fuzzy.plotted_systems import Axis, PlottedSystem

SET_COLORS = ("#2a7f62", "#d99a2b", "#b03a48", *map(to_hex, colormaps["tab20"](range(20))))
"""Colours of the sets of an input, of which there may be 16."""
BEYOND = 1.25
"""Curves extend to this multiple of the table's length, since the last entry applies to all larger values."""
FEW_ENTRIES = 8
"""An input with at most this many entries is drawn as points, which end with the last entry."""
CONTOURS = (0.25, 0.5, 0.75)
DOTS_PER_INCH = 100


# Names of an FLL file may hold dollar signs, and not every text between two of them is a formula.
@rc_context({"text.parse_math": False})
def draw_system(plotted: PlottedSystem) -> bytes:
    """Draw a PNG with the membership curves above and the rule surface below."""
    system = plotted.system()
    columns = max(len(system.inputs), len(plotted.sections))
    figure = Figure(figsize=(4.6 * columns, 7.6), layout="constrained")
    figure.suptitle(f"{plotted.title}: {len(system.rules)} rules, AND is the {system.conjunction}", size=15, wrap=True)
    curves, surfaces = figure.subfigures(2, 1, height_ratios=(4, 5), squeeze=False)[:, 0]
    for plot, variable, axis in zip(curves.subplots(1, columns), system.inputs, plotted.axes, strict=True):
        _plot_membership(plot, variable, axis)
    plots = surfaces.subplots(1, len(plotted.sections), squeeze=False)[0]
    for plot, (words, value) in zip(plots, plotted.sections, strict=True):
        mesh = _plot_surface(plot, plotted, system, words, value)
    surfaces.colorbar(mesh, ax=plots, label=plotted.output, aspect=30)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DOTS_PER_INCH)
    return buffer.getvalue()


def _plotted_entries(variable: Variable) -> NDArray[np.int64]:
    shown = variable.entries if variable.entries <= FEW_ENTRIES else round(BEYOND * variable.entries)
    return np.arange(shown)


def _plot_membership(plot: Axes, variable: Variable, axis: Axis) -> None:
    entries = _plotted_entries(variable)
    style = "o:" if variable.entries <= FEW_ENTRIES else "-"
    for (name, table), color in zip(variable.sets.items(), SET_COLORS[: len(variable.sets)], strict=True):
        degree = table[np.minimum(entries, variable.entries - 1)] / ONE
        plot.plot(axis.units(entries), degree, style, label=name, color=color, linewidth=2)
    plot.set(xlabel=axis.label, ylabel="degree of membership", ylim=(-0.04, 1.04))
    plot.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    plot.grid(alpha=0.3)


def _plot_surface(plot: Axes, plotted: PlottedSystem, system: SugenoSystem, words: str, value: int) -> QuadMesh:
    """Plot the output as colours over two inputs, one cell per table entry, with contour lines."""
    first, second = plotted.surface
    x, y = np.meshgrid(_plotted_entries(system.inputs[first]), _plotted_entries(system.inputs[second]))
    values = [np.full(x.size, value)] * len(system.inputs)
    values[first], values[second] = x.ravel(), y.ravel()
    low, high = plotted.span
    weight = low + (high - low) * system.evaluate(*values)[0].reshape(x.shape) / WEIGHT.max_raw
    x_axis, y_axis = plotted.axes[first], plotted.axes[second]
    x_units, y_units = x_axis.units(x), y_axis.units(y)
    mesh = plot.pcolormesh(
        x_units, y_units, weight, cmap="viridis", vmin=low, vmax=high, shading="nearest", rasterized=True
    )
    if min(x.shape) > FEW_ENTRIES:
        plot.contour(
            x_units,
            y_units,
            weight,
            levels=[low + (high - low) * share for share in CONTOURS],
            colors="white",
            linewidths=0.8,
        )
    else:
        plot.set_yticks(y_units[:, 0])
    plot.set(xlabel=x_axis.label, ylabel=y_axis.label, title=words)
    return mesh
