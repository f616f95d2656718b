# amaranth: UnusedElaboratable=no
"""Marks of pixels inside the border, and of the ends of cell rows and levels."""

import numpy as np
import pytest
from amaranth import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.selection.level_scan import WARNING_BEATS, LevelScan
from hdl.streams import beat
from sim.benches.drivers import run_beats
from sim.simulators.recording import Pauses

LAG_PX, BORDER_PX, CELL_LOG2 = 4, 7, 4


class ScanWithWarning(wiring.Component):
    """A scan whose warning is another mark of its beats."""

    def __init__(self, *, cells: bool, pixels_per_clock: int) -> None:
        self.scan = LevelScan(lag_px=LAG_PX, border_px=BORDER_PX, cells=cells, pixels_per_clock=pixels_per_clock)
        self.pixels_per_clock = pixels_per_clock
        marks = beat(inside=pixels_per_clock, ends_row=1, ends_level=1, row_closes=1)
        super().__init__(
            {
                **{name: In(each.shape) for name, each in self.scan.signature.members.items() if name[0] == "i"},
                "o": Out(marks),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.scan = scan = self.scan
        m.d.comb += [getattr(scan, name).eq(getattr(self, name)) for name in self.signature.members if name != "o"]
        m.d.comb += [getattr(self.o, name).eq(getattr(scan.o, name)) for name in scan.o.shape().members]
        m.d.comb += self.o.row_closes.eq(scan.o_row_closes)
        return m


@pytest.mark.parametrize(
    ("pixels_per_clock", "shape", "cells"),
    # With two cell rows, and with the end of a second one in the border.
    [(1, (41, 27), True), (2, (37, 51), True), (1, (25, 27), False)],
)
def test_marks_belong_to_the_lagging_pixel(
    pauses: Pauses, pixels_per_clock: int, shape: tuple[int, int], cells: bool
) -> None:
    height_px, width_px = shape
    dut = ScanWithWarning(cells=cells, pixels_per_clock=pixels_per_clock)
    settings = {"i_width_px": width_px, "i_height_px": height_px, "i_cell_log2": CELL_LOG2}
    frames = [{"pixel": np.zeros(shape, int)}] * 3
    sent, received = run_beats(dut, frames, settings=settings, pauses=pauses, received_per_clock=1)
    np.testing.assert_array_equal(received.cycles - sent.cycles[::pixels_per_clock], dut.scan.latency_cycles)
    # During the first frame the sizes are still new.
    _, *parts = received.split()

    y, x = np.indices(shape) - LAG_PX
    inside = (x >= BORDER_PX) & (x < width_px - BORDER_PX) & (y >= BORDER_PX) & (y < height_px - BORDER_PX)
    beats_left = (width_px - 1) // pixels_per_clock - (x + LAG_PX) // pixels_per_clock
    line_ends, lowest = beats_left == 0, height_px - 1 - BORDER_PX
    cell_ends = cells & (y >= 0) & (y % (1 << CELL_LOG2) == (1 << CELL_LOG2) - 1) & (y < lowest)
    closes = cell_ends | (y == lowest)
    # Of two pixels of a beat the left one has the lower bit; the marks are at its position.
    padded = np.pad(inside, ((0, 0), (0, width_px % pixels_per_clock)))
    expected = {
        "inside": sum(padded[:, n::pixels_per_clock] << n for n in range(pixels_per_clock)),
        "ends_row": (line_ends & closes)[:, ::pixels_per_clock],
        "ends_level": (line_ends & (y == lowest))[:, ::pixels_per_clock],
        "row_closes": (closes & (beats_left > 0) & (beats_left <= WARNING_BEATS))[:, ::pixels_per_clock],
    }
    for part in parts:
        for name, plane in expected.items():
            np.testing.assert_array_equal(part.plane(name, shape)[:, ::pixels_per_clock], plane, name)


def test_a_border_wider_than_the_smallest_level_still_ends_it() -> None:
    shape = (32, 32)
    dut = LevelScan(lag_px=LAG_PX, border_px=60, cells=True)
    settings = {"i_width_px": 32, "i_height_px": 32, "i_cell_log2": CELL_LOG2}
    _, received = run_beats(dut, [{"pixel": np.zeros(shape, int)}] * 2, settings=settings)
    _, part = received.split()
    assert not part.fields["inside"].any()
    assert part.fields["ends_level"].sum() == part.fields["ends_row"].sum() == 1
