"""Draws what the tables of the thesis page do not show, as SVG. Needs matplotlib, of the extra ``plots``."""

import io
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skymosaic.thesis import published, tables
from skymosaic.thesis.measurements import Measurements
from skymosaic.thesis.rejection import DESCRIPTORS, OURS
from skymosaic.thesis.scales import DETECTORS, REDUCTIONS

THESIS: dict[str, Any] = {"color": "#6b6b6b", "marker": "s", "linestyle": "--", "markersize": 5}
HERE: dict[str, Any] = {"color": "#2a7f62", "marker": "o", "markersize": 5, "linewidth": 2}
SECOND: dict[str, Any] = {"color": "#b3542c", "marker": "o", "markersize": 5, "linewidth": 2}
LEGEND: dict[str, Any] = {"frameon": False, "fontsize": 9}
WIDTH_IN, HEIGHT_IN = 9.0, 3.4
CORNER_TICKS = (300, 1000, 3000, 10000)


def plot_corners(m: Measurements) -> bytes:
    """Plot the number of corners against the threshold, published and measured."""
    figure, plot = _make_plot()
    _, ours = tables.calibrate_corners(m)
    thresholds = list(published.CORNERS)
    plot.plot(thresholds, [np.mean(pair) for pair in published.CORNERS.values()], label="thesis", **THESIS)
    plot.plot(thresholds, [np.mean(ours[t]) for t in thresholds], label="here", **HERE)
    plot.set(xscale="log", yscale="log", xlabel="Harris threshold, as published", ylabel="corners, mean of both images")
    plot.set_xticks(thresholds, [str(t) for t in thresholds])
    plot.set_yticks(CORNER_TICKS, [str(count) for count in CORNER_TICKS])
    plot.minorticks_off()
    plot.legend(**LEGEND)
    return _render_svg(figure)


def plot_errors(m: Measurements) -> bytes:
    """Plot the RMSE of every registered pair beside the published values."""
    figure, plot = _make_plot()
    published_px = [value for values in published.RMSE_PX.values() for value in values]
    series = {"thesis and literature": published_px}
    series |= {name: m.values("IV-5", name, "RMSE") for name in (*DESCRIPTORS, OURS)}
    rng = np.random.default_rng(0)
    for index, values in enumerate(series.values()):
        style = THESIS if index == 0 else HERE
        # Random sideways shifts keep dots of equal height apart.
        spread = index + rng.uniform(-0.15, 0.15, len(values))
        plot.plot(spread, values, style["marker"], color=style["color"], markersize=4, alpha=0.7)
    plot.set_xticks(range(len(series)), [f"{name}\n({len(values)})" for name, values in series.items()])
    plot.set(ylabel="RMSE of the inliers, px", ylim=(0, None))
    return _render_svg(figure)


def plot_scales(m: Measurements) -> bytes:
    """Plot repeatability against the reduction of the picture."""
    figure, plot = _make_plot()
    for name, style in zip(DETECTORS, (HERE, SECOND), strict=True):
        for column, look in (("repeatability", style), ("chance", {"color": style["color"], "linestyle": ":"})):
            values = [m.mean("figure IV-6", f"{name} {reduction:g}", column) for reduction in REDUCTIONS]
            label = name if column == "repeatability" else f"{name}, by chance"
            plot.plot(REDUCTIONS, values, label=label, **look)
    plot.set(xlabel="reduction of the picture", ylabel="repeatability", ylim=(0, 1.03))
    plot.legend(**LEGEND)
    return _render_svg(figure)


def _make_plot() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
    plot = figure.subplots()
    plot.grid(alpha=0.25)
    plot.spines[["top", "right"]].set_visible(False)
    return figure, plot


def _render_svg(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg")
    return buffer.getvalue()
