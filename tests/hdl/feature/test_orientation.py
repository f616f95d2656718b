"""Sums of different latency, which would meet in the wrong clock, are refused."""

import pytest
from amaranth import signed

from hdl.feature import orientation
from hdl.feature.orientation import RingMoments, Sector


@pytest.mark.usefixtures("unused_blocks")
def test_moments_of_different_latencies_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(orientation, "SINES", (1,) + (0,) * 15)
    with pytest.raises(ValueError, match=r"latency_cycles of the moments .* x has 6, y has 1"):
        RingMoments(radii_px=(3,), groups=1)


@pytest.mark.usefixtures("unused_blocks")
def test_borders_of_different_latencies_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(orientation, "HALF_SECTOR_TANGENTS", (1, 0b10101))
    with pytest.raises(ValueError, match=r"latency_cycles of the borders .* first has 1, second has 2"):
        Sector(moment=signed(12))
