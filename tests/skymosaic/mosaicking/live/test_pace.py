from collections.abc import Iterator

import numpy as np
import pytest

from golden_model.config import preset_config
from golden_model.geometry.estimator import MAX_CYCLES
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.live_frames import LiveFrame
from skymosaic.mosaicking.live.pace import Pace
from skymosaic.mosaicking.live.update import LiveUpdate

PICTURE = Photograph("", np.zeros((64, 64), np.uint8))


def test_what_is_counted_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two key frames of a stream of 15 frames per second come four seconds apart; half a second each is work."""
    now = [100.0]
    monkeypatch.setattr("skymosaic.mosaicking.live.pace.time.monotonic", lambda: now[0])

    def arriving() -> Iterator[LiveFrame]:
        for seen in (60, 120):
            now[0] += 4
            yield LiveFrame(f"frame {seen - 1}", PICTURE, seen)

    pace = Pace(preset_config("aerial"), "golden")
    for number, frame in enumerate(pace.watch(arriving())):
        now[0] += 0.5
        reason = "too few features" if number else ""
        pace.add(LiveUpdate(number, frame.name, 0.0, None, None, reason, 1))
    assert str(pace) == (
        "120 frames seen, 1 used, 1 dropped; 1 used per second of work (1.0 s), "
        "13.33 seen per second of the clock (9.0 s)"
    )
    assert pace.numbers["used_per_second_of_work"] == 1.0


@pytest.mark.parametrize(("estimator", "least", "most"), [("prosac", 0, 76_800), ("fabric", MAX_CYCLES, 310_000)])
def test_a_homography_on_the_chip_is_part_of_its_pace(estimator: str, least: int, most: int) -> None:
    config = preset_config("aerial")
    pace = Pace(config, "rtl", estimator)
    features = np.zeros(8, config.front_end.pattern.record.dtype)
    for number in range(2):
        pace.add(LiveUpdate(number, "", 0.0, None, None, "", 1, (320, 240), features))
    accelerator = pace.numbers["accelerator"]
    assert least < accelerator["clocks_per_frame"] <= most
    assert str(pace).endswith(
        f"; the accelerator at 150 MHz: {round(150e6 / accelerator['clocks_per_frame'], 1):g} per second, last pixel "
        f"to last match {accelerator['latency_ms']:g} ms"
    )


def test_no_frame_has_no_rate() -> None:
    assert str(Pace(preset_config("aerial"), "golden")) == "0 frames seen, 0 used, 0 dropped"


@pytest.mark.parametrize(("backend", "described", "timed"), [("golden", 2, False), ("rtl", 2, True), ("rtl", 1, False)])
def test_only_described_frames_of_a_simulation_have_clocks(backend: str, described: int, timed: bool) -> None:
    config = preset_config("aerial")
    pace, features = Pace(config, backend), np.zeros(8, config.front_end.pattern.record.dtype)
    for number in range(3):
        given = features if number < described else None
        pace.add(LiveUpdate(number, "", 0.0, None, None, "" if number else "blurred", 1, (320, 240), given))
    assert ("accelerator" in pace.numbers) == timed
    assert (pace.numbers["used"], pace.numbers["dropped"]) == (2, 1)
