"""The page's tables: published figures beside the measured means, and whether the published trends hold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skymosaic.thesis import published
from skymosaic.thesis.corners import THRESHOLDS
from skymosaic.thesis.measurements import Measurements
from skymosaic.thesis.rejection import DESCRIPTORS, OURS, STAGES

Sheet = list[dict[str, str]]
"""A table: the text of each row's cells, by their headings. The last row has all; a cell that a row lacks is empty."""
MISSING = "-"
MAX_TREND_WINDOW_PX = 25
"""The published number of good matches rises up to this window and falls beyond."""
LEVEL_GROWTH = 1.1
"""A count levels off if it grows by less than this factor while the threshold is halved; the published ones do."""


@dataclass(frozen=True)
class Trend:
    """A trend that the thesis shows, whether the measurements show it too, and their numbers."""

    statement: str
    holds: bool
    numbers: str


def calibrate_corners(m: Measurements) -> dict[int, tuple[float, float]]:
    """Find our mean corners in both images at each published threshold, which is scaled to our measure.

    The factor is chosen so that the mean number of corners at the highest published threshold is that of the thesis.
    """
    logs = np.log(THRESHOLDS)
    left, right = ([m.mean("IV-1", str(t), side) for t in THRESHOLDS] for side in ("left", "right"))
    highest = max(published.CORNERS)
    both = (np.array(left) + right) / 2
    # Counts fall as thresholds rise, but np.interp needs rising values: hence the reversed order.
    factor = float(np.exp(np.interp(np.mean(published.CORNERS[highest]), both[::-1], logs[::-1]))) / highest
    return {
        t: (float(np.interp(np.log(factor * t), logs, left)), float(np.interp(np.log(factor * t), logs, right)))
        for t in published.CORNERS
    }


def tabulate_corners(m: Measurements) -> Sheet:
    """Number of corners by threshold, Table IV-1."""
    ours = calibrate_corners(m)
    return [
        {
            "threshold, as published": str(t),
            "thesis, image 1 / 2": f"{first} / {second}",
            "here, image 1 / 2": f"{ours[t][0]:.0f} / {ours[t][1]:.0f}",
        }
        for t, (first, second) in published.CORNERS.items()
    ]


def tabulate_adaptive_threshold(m: Measurements) -> Sheet:
    """Corners at the first and last value of the adaptive threshold."""
    return [
        {
            "threshold": setting,
            "corners, image 1 / 2": " / ".join(
                f"{m.mean('adaptive', setting, side):.0f}" for side in ("left", "right")
            ),
            "quality of matches": _percent(m.mean("adaptive", setting, "quality")),
            "repeatability in the overlap": _percent(m.mean("adaptive", setting, "repeatability")),
        }
        for setting in m.settings("adaptive")
    ]


def tabulate_windows(m: Measurements) -> Sheet:
    """Good matches by window, Table IV-2."""
    return [
        {
            "window": f"{size}x{size}",
            "good, thesis": str(good),
            "good, here": _decimal(m.mean("IV-2", str(size), "good")),
            "matches": _decimal(m.mean("IV-2", str(size), "matches")),
            "share of false": _percent(1 - m.ratio("IV-2", str(size), "good", "matches")),
            "seconds, thesis": f"{seconds:.2f}",
            "seconds, here": f"{m.mean('IV-2', str(size), 'seconds'):.3f}",
        }
        for size, (good, seconds) in published.CORRELATION.items()
    ]


def tabulate_rings(m: Measurements) -> Sheet:
    """Good and false matches by rings, Table IV-3."""
    return [
        {
            "rings": f"{n} ({8 * n} bits)",
            "good, thesis": str(good),
            "good, here": _decimal(m.mean("IV-3", str(n), "good")),
            "false, thesis": str(matches - good),
            "false, here": _decimal(m.mean("IV-3", str(n), "matches") - m.mean("IV-3", str(n), "good")),
            "share of false, thesis": _percent(1 - good / matches),
            "here": _percent(1 - m.ratio("IV-3", str(n), "good", "matches")),
        }
        for n, (matches, good, _) in published.ILBP.items()
    ]


def tabulate_groups(m: Measurements, table: str, unit: str) -> Sheet:
    """Good matches and all matches of a table, by group of pairs."""
    return [
        {"good of all matches": f"{setting} {unit}"}
        | {
            group: f"{m.mean(table, setting, 'good', group):.1f} of {m.mean(table, setting, 'matches', group):.1f}"
            for group in m.groups
        }
        for setting in m.settings(table)
    ]


def tabulate_fuzzy_ransac(m: Measurements) -> Sheet:
    """Matches that pass each check of fuzzy RANSAC, Table IV-4."""
    columns = ("features 1", "features 2", "matched", "bidirectional", "RANSAC", "inliers")
    rows = [(f"thesis, {name}", *map(str, figures)) for name, figures in published.FUZZY_RANSAC.items()]
    rows += [(f"here, {name}", *(_decimal(m.mean("IV-4", name, c)) for c in columns)) for name in DESCRIPTORS]
    headings = ("method", *columns[:4], "RANSAC ≤ τ", "inliers")
    return [dict(zip(headings, row, strict=True)) for row in rows]


def tabulate_errors(m: Measurements) -> Sheet:
    """RMSE of the inliers, Table IV-5."""
    rows = [
        {"method": f"thesis, {name}", "RMSE of inliers, px": ", ".join(f"{value:g}" for value in values)}
        for name, values in published.RMSE_PX.items()
    ]
    return rows + [
        {
            "method": f"here, {name}",
            "pairs registered": _percent(m.mean("IV-5", name, "registered")),
            "RMSE of inliers, px": _decimal(m.mean("IV-5", name, "RMSE"), 2),
            "median distance from the truth, px": _decimal(np.median(m.values("IV-5", name, "error") or [np.nan]), 2),
        }
        for name in (*DESCRIPTORS, OURS)
    ]


def tabulate_recall(m: Measurements) -> Sheet:
    """Recall and precision, Table IV-6."""
    rows = [
        {"method": f"thesis, {name}", "as published: inliers / matched": ", ".join(f"{value:.2f}" for value in values)}
        for name, values in published.RECALL.items()
    ]
    return rows + [
        {
            "method": f"here, {name}",
            "as published: inliers / matched": _decimal(m.ratio("IV-4", name, "inliers", "matched"), 2),
            "recall": _decimal(pool_recall(m, stage), 2),
            "1 - precision": _decimal(1 - pool_precision(m, stage), 2),
        }
        for name, stage in STAGES.items()
    ]


def tabulate_seconds(m: Measurements) -> Sheet:
    """Seconds for a mosaic, Table IV-7."""
    rows = [
        {"method": f"thesis, {name}", "seconds for a mosaic": f"{value:.2f}"}
        for name, value in published.MOSAIC_SECONDS.items()
    ]
    return rows + [
        {
            "method": f"here, {name}",
            "seconds for a mosaic": f"{m.mean('IV-7', name, 'whole'):.2f}",
            "pairs registered": f"{len(m.values('IV-7', name, 'whole'))} of {len(m.pairs)}",
        }
        for name in m.settings("IV-7")
    ]


def tabulate_stages(m: Measurements) -> Sheet:
    """Matches that each fuzzy stage kept and rejected, correctly and wrongly."""
    return [
        {
            "stage": stage,
            **{count: _decimal(m.mean("stages", stage, count)) for count in ("TP", "FP", "TN", "FN")},
            "good before": _percent(pool_good_share(m, stage)),
            "good after (precision)": _percent(pool_precision(m, stage)),
            "good kept (recall)": _percent(pool_recall(m, stage)),
            "registered": _arrows([sum(m.values("stages", stage, f"registered {x}")) for x in ("before", "after")]),
        }
        for stage in m.settings("stages")
    ]


def pool_good_share(m: Measurements, stage: str) -> float:
    """Share of good matches before a stage, over all pairs together."""
    return _pool_share(m, stage, ("TP", "FN"), ("FP", "TN"))


def pool_precision(m: Measurements, stage: str) -> float:
    """Share of good matches among those that a stage kept, over all pairs together."""
    return _pool_share(m, stage, ("TP",), ("FP",))


def pool_recall(m: Measurements, stage: str) -> float:
    """Share of the good matches that a stage kept, over all pairs together (equation IV-6)."""
    return _pool_share(m, stage, ("TP",), ("FN",))


def check_trends(m: Measurements) -> list[Trend]:
    """Check the thesis's trends in the means over all pairs."""
    ours = calibrate_corners(m)
    corners = [sum(ours[t]) / 2 for t in sorted(ours, reverse=True)]
    sizes = [str(size) for size in published.CORRELATION if size <= MAX_TREND_WINDOW_PX]
    good = [m.mean("IV-2", size, "good") for size in sizes]
    seconds = [m.mean("IV-2", size, "seconds") for size in sizes]
    ring_good = [m.mean("IV-3", str(n), "good") for n in published.ILBP]
    ring_false = [1 - m.ratio("IV-3", str(n), "good", "matches") for n in published.ILBP]
    stage = "fuzzy ILBP, N = 4"
    shares = [pool_good_share(m, stage), pool_precision(m, stage)]
    sift, harris = (m.mean("figure IV-6", f"{name} 4", "repeatability") for name in ("SIFT", "Harris"))
    return [
        Trend("a lower threshold gives more corners (IV-1)", _rises(corners), _arrows(corners)),
        Trend(
            f"the number of corners levels off, at {max(published.CORNERS[min(published.CORNERS)])} (IV-1)",
            corners[-1] < LEVEL_GROWTH * corners[-2],
            _arrows(corners[-2:]) + " where the threshold is halved",
        ),
        Trend("25x25 windows give more good matches than 3x3 (IV-2)", good[-1] > good[0], _arrows(good, ".1f")),
        Trend("larger windows take more time (IV-2)", _rises(seconds), _arrows(seconds, ".3f") + " s"),
        Trend("more rings give more good matches (IV-3)", _rises(ring_good), _arrows(ring_good, ".1f")),
        Trend(
            "more rings give a smaller share of false matches (IV-3)",
            _rises(ring_false[::-1]),
            _arrows(ring_false, ".0%"),
        ),
        Trend("fuzzy ILBP raises the share of good matches", _rises(shares), _arrows(shares, ".0%")),
        Trend(
            "SIFT is more repeatable than Harris in a picture reduced by 4 (figure IV-6)",
            sift > harris,
            f"{sift:.2f} against {harris:.2f}",
        ),
    ]


def _pool_share(m: Measurements, stage: str, part: tuple[str, ...], rest: tuple[str, ...]) -> float:
    one, other = (sum(sum(m.values("stages", stage, name)) for name in names) for names in (part, rest))
    return one / (one + other) if one + other else float("nan")


def _rises(values: Sequence[float]) -> bool:
    return bool((np.diff(values) > 0).all())


def _arrows(values: Sequence[float], form: str = ".0f") -> str:
    return " → ".join(f"{value:{form}}" for value in values)


def _decimal(value: float, places: int = 1) -> str:
    return MISSING if np.isnan(value) else f"{value:.{places}f}"


def _percent(share: float) -> str:
    return MISSING if np.isnan(share) else f"{100 * share:.0f} %"
