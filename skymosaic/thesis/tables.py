"""The page's tables: published figures beside the measured means, and whether the published trends hold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skymosaic.thesis import published
from skymosaic.thesis.corners import THRESHOLDS
from skymosaic.thesis.measurements import Measurements
from skymosaic.thesis.rejection import DESCRIPTORS, OURS, STAGES

MISSING = "-"
MAX_TREND_WINDOW_PX = 25
"""The published number of good matches rises up to this window and falls beyond."""


@dataclass(frozen=True)
class Sheet:
    """A table: headings, and rows of cells as text; the first column names the row."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]


LEVEL_GROWTH = 1.1
"""A count levels off if it grows by less than this factor while the threshold is halved; the published ones do."""


@dataclass(frozen=True)
class Trend:
    """A trend that the thesis shows, whether the measurements show it too, and their numbers."""

    statement: str
    holds: bool
    numbers: str


def calibrate_corners(m: Measurements) -> tuple[float, dict[int, tuple[float, float]]]:
    """Find the factor from published thresholds to ours, and our mean corners in both images at each of them.

    The factor is chosen so that the mean number of corners at the highest published threshold is that of the thesis.
    """
    logs = np.log(THRESHOLDS)
    left, right = ([m.mean("IV-1", str(t), side) for t in THRESHOLDS] for side in ("left", "right"))
    highest = max(published.CORNERS)
    both = (np.array(left) + right) / 2
    # Counts fall as thresholds rise, but np.interp needs rising values: hence the reversed order.
    factor = float(np.exp(np.interp(np.mean(published.CORNERS[highest]), both[::-1], logs[::-1]))) / highest
    ours = {
        t: (float(np.interp(np.log(factor * t), logs, left)), float(np.interp(np.log(factor * t), logs, right)))
        for t in published.CORNERS
    }
    return factor, ours


def tabulate_corners(m: Measurements) -> Sheet:
    """Number of corners by threshold, Table IV-1."""
    _, ours = calibrate_corners(m)
    rows = [
        (str(t), f"{first} / {second}", f"{ours[t][0]:.0f} / {ours[t][1]:.0f}")
        for t, (first, second) in published.CORNERS.items()
    ]
    return Sheet(("threshold, as published", "thesis, image 1 / 2", "here, image 1 / 2"), rows)


def tabulate_adaptive_threshold(m: Measurements) -> Sheet:
    """Corners at the first and last value of the adaptive threshold."""
    rows = [
        (
            setting,
            f"{m.mean('adaptive', setting, 'left'):.0f} / {m.mean('adaptive', setting, 'right'):.0f}",
            _format_percent(m.mean("adaptive", setting, "quality")),
            _format_percent(m.mean("adaptive", setting, "repeatability")),
        )
        for setting in m.settings("adaptive")
    ]
    return Sheet(("threshold", "corners, image 1 / 2", "quality of matches", "repeatability in the overlap"), rows)


def tabulate_windows(m: Measurements) -> Sheet:
    """Good matches by window, Table IV-2."""
    rows = [
        (
            f"{size}x{size}",
            str(good),
            _format_decimal(m.mean("IV-2", str(size), "good")),
            _format_decimal(m.mean("IV-2", str(size), "matches")),
            _format_percent(1 - m.ratio("IV-2", str(size), "good", "matches")),
            f"{seconds:.2f}",
            f"{m.mean('IV-2', str(size), 'seconds'):.3f}",
        )
        for size, (good, seconds) in published.CORRELATION.items()
    ]
    headings = ("window", "good, thesis", "good, here", "matches", "share of false", "seconds, thesis", "seconds, here")
    return Sheet(headings, rows)


def tabulate_rings(m: Measurements) -> Sheet:
    """Good and false matches by rings, Table IV-3."""
    rows = [
        (
            f"{n} ({8 * n} bits)",
            str(good),
            _format_decimal(m.mean("IV-3", str(n), "good")),
            str(matches - good),
            _format_decimal(m.mean("IV-3", str(n), "matches") - m.mean("IV-3", str(n), "good")),
            _format_percent(1 - good / matches),
            _format_percent(1 - m.ratio("IV-3", str(n), "good", "matches")),
        )
        for n, (matches, good, _) in published.ILBP.items()
    ]
    headings = ("good, thesis", "good, here", "false, thesis", "false, here", "share of false, thesis", "here")
    return Sheet(("rings", *headings), rows)


def tabulate_groups(m: Measurements, table: str, unit: str) -> Sheet:
    """Good matches and all matches of a table, by group of pairs."""
    rows = [
        (
            f"{setting} {unit}",
            *(
                f"{m.mean(table, setting, 'good', group):.1f} of {m.mean(table, setting, 'matches', group):.1f}"
                for group in m.groups
            ),
        )
        for setting in m.settings(table)
    ]
    return Sheet(("good of all matches", *m.groups), rows)


def tabulate_fuzzy_ransac(m: Measurements) -> Sheet:
    """Matches that pass each check of fuzzy RANSAC, Table IV-4."""
    columns = ("features 1", "features 2", "matched", "bidirectional", "RANSAC", "inliers")
    rows = [(f"thesis, {name}", *map(str, figures)) for name, figures in published.FUZZY_RANSAC.items()]
    rows += [(f"here, {name}", *(_format_decimal(m.mean("IV-4", name, c)) for c in columns)) for name in DESCRIPTORS]
    return Sheet(("method", "features 1", "features 2", "matched", "bidirectional", "RANSAC ≤ τ", "inliers"), rows)


def tabulate_errors(m: Measurements) -> Sheet:
    """RMSE of the inliers, Table IV-5."""
    rows = [
        (f"thesis, {name}", MISSING, ", ".join(f"{value:g}" for value in values), MISSING)
        for name, values in published.RMSE_PX.items()
    ]
    rows += [
        (
            f"here, {name}",
            _format_percent(m.mean("IV-5", name, "registered")),
            _format_decimal(m.mean("IV-5", name, "RMSE"), 2),
            _format_decimal(float(np.median(m.values("IV-5", name, "error") or [np.nan])), 2),
        )
        for name in (*DESCRIPTORS, OURS)
    ]
    return Sheet(("method", "pairs registered", "RMSE of inliers, px", "median distance from the truth, px"), rows)


def tabulate_recall(m: Measurements) -> Sheet:
    """Recall and precision, Table IV-6."""
    rows = [
        (f"thesis, {name}", ", ".join(f"{value:.2f}" for value in values), MISSING, MISSING)
        for name, values in published.RECALL.items()
    ]
    rows += [
        (
            f"here, {name}",
            _format_decimal(m.ratio("IV-4", name, "inliers", "matched"), 2),
            _format_decimal(pool_recall(m, stage), 2),
            _format_decimal(1 - pool_precision(m, stage), 2),
        )
        for name, stage in STAGES.items()
    ]
    return Sheet(("method", "as published: inliers / matched", "recall", "1 - precision"), rows)


def tabulate_seconds(m: Measurements) -> Sheet:
    """Seconds for a mosaic, Table IV-7."""
    rows = [(f"thesis, {name}", f"{value:.2f}", MISSING) for name, value in published.MOSAIC_SECONDS.items()]
    rows += [
        (
            f"here, {name}",
            f"{m.mean('IV-7', name, 'whole'):.2f}",
            f"{len(m.values('IV-7', name, 'whole'))} of {len(m.pairs)}",
        )
        for name in m.settings("IV-7")
    ]
    return Sheet(("method", "seconds for a mosaic", "pairs registered"), rows)


def tabulate_stages(m: Measurements) -> Sheet:
    """Matches that each fuzzy stage kept and rejected, correctly and wrongly."""
    rows = [
        (
            stage,
            *(_format_decimal(m.mean("stages", stage, count)) for count in ("TP", "FP", "TN", "FN")),
            _format_percent(pool_good_share(m, stage)),
            _format_percent(pool_precision(m, stage)),
            _format_percent(pool_recall(m, stage)),
            f"{sum(m.values('stages', stage, 'registered before')):.0f} → "
            f"{sum(m.values('stages', stage, 'registered after')):.0f}",
        )
        for stage in m.settings("stages")
    ]
    headings = ("good before", "good after (precision)", "good kept (recall)", "registered")
    return Sheet(("stage", "TP", "FP", "TN", "FN", *headings), rows)


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
    _, corners = calibrate_corners(m)
    corner_counts = [sum(corners[t]) / 2 for t in sorted(corners, reverse=True)]
    sizes = [str(size) for size in published.CORRELATION if size <= MAX_TREND_WINDOW_PX]
    good = [m.mean("IV-2", size, "good") for size in sizes]
    seconds = [m.mean("IV-2", size, "seconds") for size in sizes]
    ring_good = [m.mean("IV-3", str(n), "good") for n in published.ILBP]
    ring_false = [1 - m.ratio("IV-3", str(n), "good", "matches") for n in published.ILBP]
    stage = "fuzzy ILBP, N = 4"
    shares = [pool_good_share(m, stage), pool_precision(m, stage)]
    sift, harris = (m.mean("figure IV-6", f"{name} 4", "repeatability") for name in ("SIFT", "Harris"))
    return [
        Trend(
            "a lower threshold gives more corners (IV-1)",
            _rises(corner_counts),
            _join_by_arrows(corner_counts, "{:.0f}"),
        ),
        Trend(
            f"the number of corners levels off, at {max(published.CORNERS[min(published.CORNERS)])} (IV-1)",
            corner_counts[-1] < LEVEL_GROWTH * corner_counts[-2],
            _join_by_arrows(corner_counts[-2:], "{:.0f}") + " where the threshold is halved",
        ),
        Trend(
            "25x25 windows give more good matches than 3x3 (IV-2)", good[-1] > good[0], _join_by_arrows(good, "{:.1f}")
        ),
        Trend("larger windows take more time (IV-2)", _rises(seconds), _join_by_arrows(seconds, "{:.3f}") + " s"),
        Trend("more rings give more good matches (IV-3)", _rises(ring_good), _join_by_arrows(ring_good, "{:.1f}")),
        Trend(
            "more rings give a smaller share of false matches (IV-3)",
            _rises(ring_false[::-1]),
            _join_by_arrows(ring_false, "{:.0%}"),
        ),
        Trend("fuzzy ILBP raises the share of good matches", _rises(shares), _join_by_arrows(shares, "{:.0%}")),
        Trend(
            "SIFT is more repeatable than Harris in a picture reduced by 4 (figure IV-6)",
            _rises([harris, sift]),
            f"{sift:.2f} against {harris:.2f}",
        ),
    ]


def _pool_share(m: Measurements, stage: str, part: tuple[str, ...], rest: tuple[str, ...]) -> float:
    one, other = (sum(sum(m.values("stages", stage, name)) for name in names) for names in (part, rest))
    return one / (one + other) if one + other else float("nan")


def _rises(values: Sequence[float]) -> bool:
    return bool((np.diff(values) > 0).all())


def _join_by_arrows(values: Sequence[float], form: str) -> str:
    return " → ".join(form.format(value) for value in values)


def _format_decimal(value: float, places: int = 1) -> str:
    return MISSING if np.isnan(value) else f"{value:.{places}f}"


def _format_percent(share: float) -> str:
    return MISSING if np.isnan(share) else f"{100 * share:.0f} %"
