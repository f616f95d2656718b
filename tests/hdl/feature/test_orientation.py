"""Sectors equal the golden model at every border; sums that would meet in the wrong clock are refused."""

import numpy as np
import pytest
from amaranth import signed

from golden_model.feature.orientation import HALF_SECTOR_TANGENTS, TANGENT_ONE, sector_of
from hdl.blocks.vectors import Block, of_stream
from hdl.feature import orientation
from hdl.feature.orientation import RingMoments, Sector
from tests.hdl.rows import Clocked, row_test

LARGEST = (1 << 15) - 1


def sectors() -> Block:
    """On each border of the first octant and on both sides of it, in all octants; axes, diagonals, ends and zero."""
    borders = [(TANGENT_ONE, tangent + d) for tangent in HALF_SECTOR_TANGENTS for d in (-1, 0, 1)]
    octant = np.array([*borders, (LARGEST, 0), (1, 0), (LARGEST, LARGEST), (LARGEST, LARGEST - 1), (0, 0)])
    turned = np.concatenate((octant, octant[:, ::-1]))
    moments = np.concatenate([turned * sign for sign in ((1, 1), (-1, 1), (1, -1), (-1, -1))])
    found = sector_of(*moments.T).tolist()
    assert set(found) == set(range(16))
    sent = [{"mx": x, "my": y} for x, y in moments.tolist()]
    return of_stream(
        Clocked(Sector(moment=signed(16), spacing_cycles=1)), "", sent, [{"sector": each} for each in found]
    )


test_rows = row_test({"sectors": sectors})


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
