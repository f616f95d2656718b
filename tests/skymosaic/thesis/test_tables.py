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


def test_our_thresholds_are_scaled_to_the_published_corners(measured: Measurements) -> None:
    _, ours = tables.calibrate_corners(measured)
    highest = max(published.CORNERS)
    assert np.mean(ours[highest]) == pytest.approx(np.mean(published.CORNERS[highest]), rel=0.05)
