"""The page's tables: published figures beside the measured means, and whether the published trends hold."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from skymosaic.thesis.corners import THRESHOLDS
from skymosaic.thesis.experiments import STAGES
from skymosaic.thesis.measurements import Measurement, Measurements
from skymosaic.thesis.published import PUBLISHED

Sheet = list[dict[str, str]]
"""A table: the text of each row's cells, by their headings."""
MISSING = "-"
MAX_TREND_WINDOW_PX = 25
"""The published number of good matches rises up to this window and falls beyond."""
LEVEL_GROWTH = 1.1
"""A count levels off if it grows by less than this factor while the threshold is halved; the published ones do."""

METHOD = ("thesis, {setting}", "here, {setting}")
TABLES: dict[str, dict[str, str | tuple[str, str]]] = {
    "IV-1": {
        "threshold, as published": "{setting}",
        "thesis, image 1 / 2": "{thesis left:.0f} / {thesis right:.0f}",
        "here, image 1 / 2": "{left:.0f} / {right:.0f}",
    },
    "adaptive": {
        "threshold": "{setting}",
        "corners, image 1 / 2": "{left:.0f} / {right:.0f}",
        "quality of matches": "{quality:.0%}",
        "repeatability in the overlap": "{repeatability:.0%}",
    },
    "IV-2": {
        "window": "{setting}x{setting}",
        "good, thesis": "{thesis good:.0f}",
        "good, here": "{good:.1f}",
        "matches": "{matches:.1f}",
        "share of false": "{matches-good / matches:.0%}",
        "seconds, thesis": "{thesis seconds:.2f}",
        "processor seconds, here": "{seconds:.3f}",
    },
    "IV-3": {
        "rings": "{setting} ({thesis bits:.0f} bits)",
        "good, thesis": "{thesis good:.0f}",
        "good, here": "{good:.1f}",
        "false, thesis": "{thesis matches-good:.0f}",
        "false, here": "{matches-good:.1f}",
        "share of false, thesis": "{thesis matches-good / matches:.0%}",
        "here": "{matches-good / matches:.0%}",
    },
    "IV-4": {
        "method": METHOD,
        "features 1": ("{features 1:.0f}", "{features 1:.1f}"),
        "features 2": ("{features 2:.0f}", "{features 2:.1f}"),
        "matched": ("{matched:.0f}", "{matched:.1f}"),
        "bidirectional": ("{bidirectional:.0f}", "{bidirectional:.1f}"),
        "RANSAC ≤ τ": ("{RANSAC:.0f}", "{RANSAC:.1f}"),
        "inliers": ("{inliers:.0f}", "{inliers:.1f}"),
    },
    "IV-5": {
        "method": METHOD,
        "pairs registered": (MISSING, "{registered:.0%}"),
        "RMSE of inliers, px": ("{each RMSE:g}", "{RMSE:.2f}"),
        "median distance from the truth, px": (MISSING, "{median error:.2f}"),
    },
    "IV-6": {
        "method": METHOD,
        "as published: inliers / matched": ("{each recall:.2f}", "{IV-4 inliers / matched:.2f}"),
        "recall": (MISSING, "{stage TP / TP+FN:.2f}"),
        "1 - precision": (MISSING, "{stage FP / TP+FP:.2f}"),
    },
    "IV-7": {
        "method": METHOD,
        "seconds for a mosaic (here: processor seconds)": "{whole:.2f}",
        "pairs registered": (MISSING, "{number whole:.0f} of {pairs}"),
    },
    "stages": {
        "stage": "{setting}",
        "TP": "{TP:.1f}",
        "FP": "{FP:.1f}",
        "TN": "{TN:.1f}",
        "FN": "{FN:.1f}",
        "good before": "{TP+FN / TP+FN+FP+TN:.0%}",
        "good after (precision)": "{TP / TP+FP:.0%}",
        "good kept (recall)": "{TP / TP+FN:.0%}",
        "registered": "{sum registered before:.0f} → {sum registered after:.0f}",
    },
}
"""Of each table, what its cells say, by their headings; in braces stands a key of `_Row` and a format.

Where there are two texts, the first is of the thesis's methods, which have rows of their own, the second of ours.
"""
HOW: dict[str, Callable[[list[float]], ArrayLike]] = {
    "each": list, "sum": sum, "number": len, "median": lambda values: np.median(values or [np.nan])
}  # fmt: skip
"""What a key of `_Row` may say before the quantity, in place of its mean."""


class _Values(list[float]):
    """Numbers of a cell, written with commas; "-" if there are none."""

    def __format__(self, form: str) -> str:
        text = ", ".join(f"{value:{form}}" for value in self).replace("%", " %")
        return MISSING if not self or np.isnan(self).any() else text


@dataclass(frozen=True)
class _Row:
    """The cells of a row by their keys, which are those of `Measurements.number`.

    A key may begin with "thesis" for the published number, "IV-4" for that of another table, "stage" for that of the
    method as a fuzzy stage, or a word of `HOW`.
    """

    m: Measurements
    table: str
    setting: str

    def __getitem__(self, key: str) -> object:
        if key in ("setting", "pairs"):
            return self.setting if key == "setting" else len(self.m.pairs)
        first, _, rest = key.partition(" ")
        if first == "thesis":
            return replace(self, m=PUBLISHED)[rest]
        if first == "IV-4":
            return replace(self, table=first)[rest]
        if first == "stage":
            return replace(self, table="stages", setting=STAGES[self.setting])[rest]
        if first in HOW:
            return _Values(np.atleast_1d(HOW[first](self.m.values(self.table, self.setting, rest))))
        return _Values([self.m.number(self.table, self.setting, key)])


def tabulate(m: Measurements, table: str) -> Sheet:
    """Write one of `TABLES`."""
    sources = [PUBLISHED, m] if "method" in TABLES[table] else [m]
    return [
        {
            heading: (text if isinstance(text, str) else text[source is m]).format_map(_Row(source, table, setting))
            for heading, text in TABLES[table].items()
        }
        for source in sources
        # Table IV-6 is computed from what was measured for Table IV-4.
        for setting in source.settings("IV-4" if table == "IV-6" and source is m else table)
    ]


def tabulate_groups(m: Measurements, table: str, unit: str) -> Sheet:
    """Good matches and all matches of a table, by group of pairs."""
    return [
        {"good of all matches": f"{setting} {unit}"}
        | {
            name: f"{group.number(table, setting, 'good'):.1f} of {group.number(table, setting, 'matches'):.1f}"
            for name, group in m.groups.items()
        }
        for setting in m.settings(table)
    ]


def scale_thresholds(m: Measurements) -> Measurements:
    """The measurements with our mean corners at each published threshold, which is scaled to our measure.

    The factor is chosen so that the mean number of corners at the highest published threshold is that of the thesis.
    """
    settings, logs = PUBLISHED.settings("IV-1"), np.log(THRESHOLDS)
    counts = {side: [m.number("IV-1", str(t), side) for t in THRESHOLDS] for side in ("left", "right")}
    counts["both"] = np.mean(list(counts.values()), axis=0).tolist()
    # Counts fall as thresholds rise, but np.interp needs rising values: hence the reversed order.
    highest = np.interp(PUBLISHED.number("IV-1", settings[0], "both"), counts["both"][::-1], logs[::-1])
    lines = [line for line in m.lines if line.table != "IV-1"]
    for setting in settings:
        log = highest + np.log(float(setting) / float(settings[0]))
        values = {name: float(np.interp(log, logs, count)) for name, count in counts.items()}
        lines.append(Measurement("IV-1", setting, m.pairs[0], m.lines[0].group, values))
    return Measurements(lines)


@dataclass(frozen=True)
class Trend:
    """A trend that the thesis shows, whether the measurements show it too, and their numbers."""

    statement: str
    holds: bool
    numbers: str


def check_trends(m: Measurements) -> list[Trend]:
    """Check the thesis's trends in the means over all pairs; the thresholds are those of `scale_thresholds`."""

    def series(table: str, key: str, largest: float = np.inf) -> list[float]:
        return [m.number(table, each, key) for each in PUBLISHED.settings(table) if float(each) <= largest]

    corners = series("IV-1", "both")
    good, seconds = (series("IV-2", key, MAX_TREND_WINDOW_PX) for key in ("good", "seconds"))
    ring_good, ring_false = series("IV-3", "good"), series("IV-3", "matches-good / matches")
    shares = [m.number("stages", "fuzzy ILBP, N = 4", key) for key in ("TP+FN / TP+FN+FP+TN", "TP / TP+FP")]
    sift, harris = (m.number("figure IV-6", f"{name} 4", "repeatability") for name in ("SIFT", "Harris"))
    most = PUBLISHED.number("IV-1", PUBLISHED.settings("IV-1")[-1], "right")
    levels_off = corners[-1] < LEVEL_GROWTH * corners[-2]
    rows = [
        ("a lower threshold gives more corners (IV-1)", _rises(corners), _arrows(corners)),
        (
            f"the number of corners levels off, at {most:.0f} (IV-1)",
            levels_off,
            _arrows(corners[-2:]) + " where the threshold is halved",
        ),
        ("25x25 windows give more good matches than 3x3 (IV-2)", good[-1] > good[0], _arrows(good, ".1f")),
        ("larger windows take more time (IV-2)", _rises(seconds), _arrows(seconds, ".3f") + " s"),
        ("more rings give more good matches (IV-3)", _rises(ring_good), _arrows(ring_good, ".1f")),
        (
            "more rings give a smaller share of false matches (IV-3)",
            _rises(ring_false[::-1]),
            _arrows(ring_false, ".0%"),
        ),
        ("fuzzy ILBP raises the share of good matches", _rises(shares), _arrows(shares, ".0%")),
        (
            "SIFT is more repeatable than Harris in a picture reduced by 4 (figure IV-6)",
            sift > harris,
            f"{sift:.2f} against {harris:.2f}",
        ),
    ]
    return [Trend(*row) for row in rows]


def _rises(values: Sequence[float]) -> bool:
    return bool((np.diff(values) > 0).all())


def _arrows(values: Sequence[float], form: str = ".0f") -> str:
    return " → ".join(f"{value:{form}}" for value in values)
