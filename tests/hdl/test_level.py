"""What meets a corner in a level comes neither later nor from another pixel."""

from typing import Any

import pytest

from golden_model.config import FrontEndConfig
from hdl.feature.ring_window import RingWindow
from hdl.level import Level
from hdl.selection.level_scan import LevelScan


class LateRings(RingWindow):
    def __init__(self, **parameters: Any) -> None:
        super().__init__(**parameters)
        self.latency_cycles += 100


def level() -> Level:
    return Level(config=FrontEndConfig(), level=0, width_px=64)


@pytest.mark.usefixtures("unused_blocks")
def test_ring_pixels_that_come_after_their_corner_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdl.level.RingWindow", LateRings)
    with pytest.raises(ValueError, match="ring pixels take 116 clocks, but the path that they meet only 55"):
        level()


@pytest.mark.usefixtures("unused_blocks")
def test_marks_that_come_after_their_corner_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LevelScan, "latency_cycles", 100)
    with pytest.raises(ValueError, match="marks of the scan take 100 clocks, but the path that they meet only 53"):
        level()
