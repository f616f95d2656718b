"""Laps follow each other, and what was measured before stays."""

import time

import pytest

from skymosaic.common.stopwatch import Stopwatch


def test_a_lap_lasts_from_the_end_of_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "perf_counter", iter([10.0, 10.5, 12.5]).__next__)
    clock = Stopwatch({"reading": 3.0})
    assert (clock.lap("matching"), clock.lap("blending")) == (0.5, 2.0)
    assert clock.seconds == {"reading": 3.0, "matching": 0.5, "blending": 2.0}
