from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skymosaic.thesis import published, tables
from skymosaic.thesis.measurements import Measurements


def test_the_published_trends_hold_on_a_rendered_flight(measured: Measurements) -> None:
    # Seconds are left out: a busy machine decides them.
    found = {trend.statement: trend for trend in tables.check_trends(measured) if "time" not in trend.statement}
    assert len(found) == 7
    # Our corners are not limited in number; the thesis does not say what limits its own.
    assert {statement for statement, trend in found.items() if not trend.holds} == {
        "the number of corners levels off, at 734 (IV-1)"
    }


@pytest.mark.parametrize(
    ("method", "altered", "says"),
    [
        ("mean", ("IV-2", "25", "good"), "25x25 windows give more good matches"),
        ("mean", ("IV-2", "10", "seconds"), "larger windows take more time"),
        ("mean", ("IV-3", "3", "good"), "more rings give more good matches"),
        ("ratio", ("IV-3", "3", "good"), "more rings give a smaller share"),
        ("mean", ("figure IV-6", "SIFT 4", "repeatability"), "SIFT is more repeatable"),
    ],
    ids=str,
)
def test_a_trend_that_one_figure_breaks_does_not_hold(
    measured: Measurements, method: str, altered: tuple[str, ...], says: str
) -> None:
    def value(*key: str) -> float:
        return 0.0 if key[:3] == altered else getattr(measured, method)(*key)

    figures: Any = SimpleNamespace(mean=measured.mean, ratio=measured.ratio, values=measured.values)
    vars(figures)[method] = value
    (trend,) = (each for each in tables.check_trends(figures) if each.statement.startswith(says))
    assert not trend.holds


def test_our_thresholds_are_scaled_to_the_published_corners(measured: Measurements) -> None:
    ours = tables.calibrate_corners(measured)
    highest = max(published.CORNERS)
    assert np.mean(ours[highest]) == pytest.approx(np.mean(published.CORNERS[highest]), rel=0.05)
