"""Draws the diagrams of the thesis page as SVG. Needs matplotlib, which the extra ``plots`` installs."""

import io
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skymosaic.thesis.experiments import DESCRIPTORS, DETECTORS, OURS, REDUCTIONS
from skymosaic.thesis.measurements import Measurements
from skymosaic.thesis.published import PUBLISHED

THESIS: dict[str, Any] = {"color": "#6b6b6b", "marker": "s", "linestyle": "--", "markersize": 5}
HERE: dict[str, Any] = {"color": "#2a7f62", "marker": "o", "markersize": 5, "linewidth": 2}
SECOND: dict[str, Any] = {"color": "#b3542c", "marker": "o", "markersize": 5, "linewidth": 2}
WIDTH_IN, HEIGHT_IN = 9.0, 3.4
CORNER_TICKS = (300, 1000, 3000, 10000)
THRESHOLDS = [int(threshold) for threshold in PUBLISHED.settings("IV-1")]

CORNERS = {
    "ylabel": "corners, mean of both images",
    **{"xscale": "log", "xticks": THRESHOLDS, "xticklabels": THRESHOLDS},
    **{"yscale": "log", "yticks": CORNER_TICKS, "yticklabels": CORNER_TICKS},
}
GOOD = {"ylabel": "good matches", "ylim": (0, None)}
RINGS = [int(rings) for rings in PUBLISHED.settings("IV-3")]
FALSE = {"ylabel": "share of false matches", "ylim": (0, 1.03), "xticks": RINGS}
PANELS: dict[str, tuple[str, dict[str, Mapping[str, Any]]]] = {
    "IV-1": ("Harris threshold, as published", {"both": CORNERS}),
    "IV-2": ("side of the window, px", {"good": GOOD, "seconds": {"ylabel": "seconds", "yscale": "log"}}),
    "IV-3": ("rings of the ILBP", {"good": {**GOOD, "xticks": RINGS}, "matches-good / matches": FALSE}),
}
"""Of each table whose settings are numbers, the label of these, and the keys and axes of its panels."""


def plot_settings(m: Measurements, table: str) -> bytes:
    """Plot numbers of a table against its settings, published and measured, as `PANELS` says."""
    xlabel, panels = PANELS[table]
    figure, plots = _make_plots(len(panels))
    settings = PUBLISHED.settings(table)
    for plot, (key, axes) in zip(plots, panels.items(), strict=True):
        for label, source, style in (("thesis", PUBLISHED, THESIS), ("here", m, HERE)):
            numbers = [source.number(table, setting, key) for setting in settings]
            plot.plot([float(setting) for setting in settings], numbers, label=label, **style)
        plot.set(xlabel=xlabel, **axes)
        if "xticklabels" in axes:
            # Those of Matplotlib stand between.
            plot.minorticks_off()
    return _render_svg(figure)


def plot_fuzzy_ransac(m: Measurements) -> bytes:
    """Plot the matches that pass each check of fuzzy RANSAC, as shares of all matches."""
    figure, (plot,) = _make_plots(1)
    columns = ("matched", "bidirectional", "RANSAC", "inliers")
    thesis = PUBLISHED.settings("IV-4")
    series = {
        "thesis, mean of five": np.array([np.mean([PUBLISHED.number("IV-4", s, c) for s in thesis]) for c in columns])
    }
    series |= {f"here, {name}": np.array([m.number("IV-4", name, c) for c in columns]) for name in DESCRIPTORS}
    colors = ("#9a9a9a", "#d99a2b", "#2a7f62", "#33658a")
    for index, ((name, counts), color) in enumerate(zip(series.items(), colors, strict=True)):
        centres = np.arange(len(columns)) + 0.2 * (index - 1.5)
        bars = plot.bar(centres, counts / counts[0], 0.19, label=name, color=color)
        plot.bar_label(bars, [f"{count:.0f}" for count in counts], fontsize=8)
    plot.set_xticks(range(len(columns)), ("matched", "bidirectional check", "RANSAC ≤ τ", "inliers: both"))
    plot.set(ylabel="share of all matches", ylim=(0, 1.08))
    return _render_svg(figure, legend="above")


def plot_errors(m: Measurements) -> bytes:
    """Plot the RMSE of every registered pair beside the published values."""
    figure, (plot,) = _make_plots(1)
    published = [px for name in PUBLISHED.settings("IV-5") for px in PUBLISHED.values("IV-5", name, "RMSE")]
    series = {"thesis and literature": published}
    series |= {name: m.values("IV-5", name, "RMSE") for name in (*DESCRIPTORS, OURS)}
    rng = np.random.default_rng(0)
    for index, values in enumerate(series.values()):
        style = THESIS if index == 0 else HERE
        # Random sideways shifts keep dots of equal height apart.
        spread = index + rng.uniform(-0.15, 0.15, len(values))
        plot.plot(spread, values, style["marker"], color=style["color"], markersize=4, alpha=0.7)
    plot.set_xticks(range(len(series)), [f"{name}\n({len(values)})" for name, values in series.items()])
    plot.set(ylabel="RMSE of the inliers, px", ylim=(0, None))
    return _render_svg(figure, legend=None)


def plot_stages(m: Measurements) -> bytes:
    """Plot the share of good matches before and after each fuzzy stage, and its recall."""
    names = m.settings("stages")
    figure = Figure(figsize=(WIDTH_IN, 0.36 * len(names) + 1.2), layout="constrained")
    plot = figure.subplots()
    rows = np.arange(len(names))[::-1]
    before, after, kept = (
        np.array([m.number("stages", name, key) for name in names])
        for key in ("TP+FN / TP+FN+FP+TN", "TP / TP+FP", "TP / TP+FN")
    )
    plot.hlines(rows, before, after, color="#c9c9c9", linewidth=3)
    plot.plot(before, rows, "s", color=THESIS["color"], label="good among all matches")
    plot.plot(after, rows, "o", color=HERE["color"], label="good among the kept (precision)")
    plot.plot(kept, rows, "x", color=SECOND["color"], label="kept among the good (recall)", markeredgewidth=2)
    plot.set_yticks(rows, names)
    plot.set(xlim=(-0.02, 1.02))
    return _render_svg(figure, legend="above")


def plot_scales(m: Measurements) -> bytes:
    """Plot repeatability against the reduction of the picture."""
    figure, (plot,) = _make_plots(1)
    for name, style in zip(DETECTORS, (HERE, SECOND), strict=True):
        for column, look in (("repeatability", style), ("chance", {"color": style["color"], "linestyle": ":"})):
            values = [m.number("figure IV-6", f"{name} {reduction:g}", column) for reduction in REDUCTIONS]
            label = name if column == "repeatability" else f"{name}, by chance"
            plot.plot(REDUCTIONS, values, label=label, **look)
    plot.set(xlabel="reduction of the picture", ylabel="repeatability", ylim=(0, 1.03))
    return _render_svg(figure)


def _make_plots(count: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
    return figure, list(figure.subplots(1, count, squeeze=False)[0])


def _render_svg(figure: Figure, legend: Literal["inside", "above"] | None = "inside") -> bytes:
    for plot in figure.axes:
        plot.grid(alpha=0.25)
        plot.spines[["top", "right"]].set_visible(False)
        if legend == "inside":
            plot.legend(frameon=False, fontsize=9)
    if legend == "above":
        figure.legend(frameon=False, fontsize=9, loc="outside upper center", ncols=4)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg")
    return buffer.getvalue()


CHARTS: dict[str, Callable[[Measurements], bytes]] = {
    **{table: partial(plot_settings, table=table) for table in PANELS},
    "IV-4": plot_fuzzy_ransac,
    "IV-5": plot_errors,
    "stages": plot_stages,
    "figure IV-6": plot_scales,
}
"""The diagram of each table."""
