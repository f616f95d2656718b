"""The time that is left, by the steps of a stage."""

import pytest

from skymosaic.panel.steps import Steps


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr("skymosaic.panel.steps.time.monotonic", lambda: now[0])
    return now


def test_the_time_left_follows_the_pace_of_the_stage(clock: list[float]) -> None:
    followed = Steps()
    followed.follow("features", 0, 10)
    assert followed.seconds_left() is None
    clock[0] += 6
    # Not before the first of the steps is done.
    assert followed.seconds_left() is None
    followed.follow("features", 1, 10)
    assert followed.seconds_left() == pytest.approx(54)
    followed.follow("features", 3, 10)
    assert followed.share == pytest.approx(0.3)
    assert followed.seconds_left() == pytest.approx(14)
    followed.follow("pairs", 1, 4)
    clock[0] += 0.9
    followed.follow("pairs", 3, 4)
    assert followed.seconds_left() is None
    clock[0] += 4.1
    assert followed.seconds_left() == pytest.approx(2.5)
    followed.follow("writing", 0, 0)
    assert followed.share is None
    assert followed.seconds_left() is None
