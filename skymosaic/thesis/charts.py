"""Draws the diagrams of the thesis page as SVG. Needs matplotlib, which the extra ``plots`` installs."""

import io
from typing import Any, Literal

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
WIDTH_IN, HEIGHT_IN = 9.0, 3.4
CORNER_TICKS = (300, 1000, 3000, 10000)


def plot_corners(m: Measurements) -> bytes:
    """Plot the number of corners against the threshold, published and measured."""
    figure, (plot,) = _make_plots(1)
    ours = tables.calibrate_corners(m)
    thresholds = list(published.CORNERS)
    plot.plot(thresholds, [np.mean(pair) for pair in published.CORNERS.values()], label="thesis", **THESIS)
    plot.plot(thresholds, [np.mean(ours[t]) for t in thresholds], label="here", **HERE)
    plot.set(xscale="log", yscale="log", xlabel="Harris threshold, as published", ylabel="corners, mean of both images")
    plot.set_xticks(thresholds, [str(t) for t in thresholds])
    plot.set_yticks(CORNER_TICKS, [str(count) for count in CORNER_TICKS])
    plot.minorticks_off()
    return _render_svg(figure)


def plot_windows(m: Measurements) -> bytes:
    """Plot good matches and seconds against the side of the window."""
    figure, (good, seconds) = _make_plots(2)
    sizes = list(published.CORRELATION)
    good.plot(sizes, [figures[0] for figures in published.CORRELATION.values()], label="thesis", **THESIS)
    good.plot(sizes, [m.mean("IV-2", str(s), "good") for s in sizes], label="here", **HERE)
    good.set(xlabel="side of the window, px", ylabel="good matches", ylim=(0, None))
    seconds.plot(sizes, [figures[1] for figures in published.CORRELATION.values()], label="thesis", **THESIS)
    seconds.plot(sizes, [m.mean("IV-2", str(s), "seconds") for s in sizes], label="here", **HERE)
    seconds.set(xlabel="side of the window, px", ylabel="seconds", yscale="log")
    return _render_svg(figure)


def plot_rings(m: Measurements) -> bytes:
    """Plot good matches and the share of false ones against the number of rings of the ILBP."""
    figure, (good, false) = _make_plots(2)
    counts = list(published.ILBP)
    good.plot(counts, [figures[1] for figures in published.ILBP.values()], label="thesis", **THESIS)
    good.plot(counts, [m.mean("IV-3", str(n), "good") for n in counts], label="here", **HERE)
    good.set(xlabel="rings of the ILBP", ylabel="good matches", ylim=(0, None), xticks=counts)
    false.plot(counts, [1 - figures[1] / figures[0] for figures in published.ILBP.values()], label="thesis", **THESIS)
    false.plot(counts, [1 - m.ratio("IV-3", str(n), "good", "matches") for n in counts], label="here", **HERE)
    false.set(xlabel="rings of the ILBP", ylabel="share of false matches", ylim=(0, 1.03), xticks=counts)
    return _render_svg(figure)


def plot_fuzzy_ransac(m: Measurements) -> bytes:
    """Plot the matches that pass each check of fuzzy RANSAC, as shares of all matches."""
    figure, (plot,) = _make_plots(1)
    columns = ("matched", "bidirectional", "RANSAC", "inliers")
    series = {"thesis, mean of five": np.mean(list(published.FUZZY_RANSAC.values()), axis=0)[2:]}
    series |= {f"here, {name}": np.array([m.mean("IV-4", name, c) for c in columns]) for name in DESCRIPTORS}
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
    return _render_svg(figure, legend=None)


def plot_stages(m: Measurements) -> bytes:
    """Plot the share of good matches before and after each fuzzy stage, and its recall."""
    names = m.settings("stages")
    figure = Figure(figsize=(WIDTH_IN, 0.36 * len(names) + 1.2), layout="constrained")
    plot = figure.subplots()
    rows = np.arange(len(names))[::-1]
    before, after = (
        np.array([share(m, name) for name in names]) for share in (tables.pool_good_share, tables.pool_precision)
    )
    plot.hlines(rows, before, after, color="#c9c9c9", linewidth=3)
    plot.plot(before, rows, "s", color=THESIS["color"], label="good among all matches")
    plot.plot(after, rows, "o", color=HERE["color"], label="good among the kept (precision)")
    kept = [tables.pool_recall(m, name) for name in names]
    plot.plot(kept, rows, "x", color=SECOND["color"], label="kept among the good (recall)", markeredgewidth=2)
    plot.set_yticks(rows, names)
    plot.set(xlim=(-0.02, 1.02))
    return _render_svg(figure, legend="above")


def plot_scales(m: Measurements) -> bytes:
    """Plot repeatability against the reduction of the picture."""
    figure, (plot,) = _make_plots(1)
    for name, style in zip(DETECTORS, (HERE, SECOND), strict=True):
        for column, look in (("repeatability", style), ("chance", {"color": style["color"], "linestyle": ":"})):
            values = [m.mean("figure IV-6", f"{name} {reduction:g}", column) for reduction in REDUCTIONS]
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
