from types import SimpleNamespace
from typing import Any

import pytest

from skymosaic.thesis import tables
from skymosaic.thesis.measurements import Measurements
from skymosaic.thesis.published import PUBLISHED


def test_the_published_trends_hold_on_a_rendered_flight(measured: Measurements) -> None:
    # Seconds are left out: a busy machine decides them.
    trends = tables.check_trends(tables.scale_thresholds(measured))
    found = {trend.statement: trend for trend in trends if "time" not in trend.statement}
    assert len(found) == 7
    # Our corners are not limited in number; the thesis does not say what limits its own.
    assert {statement for statement, trend in found.items() if not trend.holds} == {
        "the number of corners levels off, at 734 (IV-1)"
    }


@pytest.mark.parametrize(
    ("altered", "says"),
    [
        (("IV-2", "25", "good"), "25x25 windows give more good matches"),
        (("IV-2", "10", "seconds"), "larger windows take more time"),
        (("IV-3", "3", "good"), "more rings give more good matches"),
        (("IV-3", "3", "matches-good / matches"), "more rings give a smaller share"),
        (("figure IV-6", "SIFT 4", "repeatability"), "SIFT is more repeatable"),
    ],
    ids=str,
)
def test_a_trend_that_one_figure_breaks_does_not_hold(
    measured: Measurements, altered: tuple[str, ...], says: str
) -> None:
    m = tables.scale_thresholds(measured)
    figures: Any = SimpleNamespace(number=lambda *key: 0.0 if key == altered else m.number(*key))
    (trend,) = (each for each in tables.check_trends(figures) if each.statement.startswith(says))
    assert not trend.holds


def test_our_thresholds_are_scaled_to_the_published_corners(measured: Measurements) -> None:
    scaled = tables.scale_thresholds(measured)
    assert scaled.settings("IV-1") == PUBLISHED.settings("IV-1")
    assert scaled.number("IV-1", "5000", "both") == pytest.approx(PUBLISHED.number("IV-1", "5000", "both"), rel=0.05)


def test_methods_that_registered_no_pair_have_no_row_of_seconds(measured: Measurements) -> None:
    without = Measurements([line for line in measured.lines if line.table != "IV-7"])
    assert all(row["method"].startswith("thesis, ") for row in tables.tabulate(without, "IV-7"))
