"""Parameters that a block cannot have are named, and paths that would meet in the wrong clock or pixel are refused."""

from collections.abc import Callable, Mapping
from typing import Any

import pytest
from amaranth.hdl import Fragment

from golden_model.config import FrontEndConfig
from hdl.pixel.corners import Corners
from hdl.pixel.fast import Fast
from hdl.pixel.gradients import GradientColumns
from hdl.pixel.harris import StructureTensor
from hdl.pixel.nms import Suppression
from hdl.pixel.window import LineBuffer, Window


def corners() -> Corners:
    return Corners(config=FrontEndConfig(levels=1, threshold=30), width_px=27)


def late_suppression() -> Suppression:
    block = Suppression(radius_px=1, width_px=64)
    block.latency_cycles += 1
    return block


@pytest.mark.usefixtures("unused_blocks")
@pytest.mark.parametrize(
    ("changes", "make", "message"),
    [
        ({}, lambda: Fast(lag_px=2), "lag_px is 2; it must be a whole number from 3 on"),
        ({"fast.Fast.latency_cycles": 23}, Fast, "latency_cycles of FAST .* scan has 23, codes has 22"),
        ({}, lambda: StructureTensor(window_px=4), "window_px is 4"),
        ({}, lambda: Suppression(radius_px=2, width_px=64), "radius_px is 2"),
        ({}, late_suppression, "latency_cycles of the suppression .* scan has 9, codes has 8"),
        ({}, lambda: LineBuffer(shape=8, lines=0, width_px=64), "lines is 0"),
        ({}, lambda: LineBuffer(shape=8, lines=1, width_px=3), "width_px is 3"),
        ({}, lambda: Window(shape=8, columns=0), "columns is 0"),
        (
            {"gradients.PASSED_LAG_PX": 2},
            lambda: GradientColumns(smoothed=True, width_px=24),
            "lag_px of the gray .* smoothed has 1, passed has 2",
        ),
        # FAST waits for Harris; nothing makes Harris wait.
        ({"harris.StructureTensor.lag_px": 1}, corners, "lag_px is 2; it must be a whole number from 3 on"),
        ({"gradients.GradientColumns.pixel_lines": 6}, corners, r"FAST needs \d lines of pixels, but 6 are stored"),
    ],
)
def test_what_cannot_be_is_refused(
    monkeypatch: pytest.MonkeyPatch, changes: Mapping[str, Any], make: Callable[[], Any], message: str
) -> None:
    for name, value in changes.items():
        monkeypatch.setattr(f"hdl.pixel.{name}", value)
    with pytest.raises(ValueError, match=message):
        Fragment.get(make(), None)
