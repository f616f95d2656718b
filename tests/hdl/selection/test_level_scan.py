# amaranth: UnusedElaboratable=no
"""Marks of pixels inside the border, and of the ends of cell rows and levels."""

from typing import Any

import numpy as np
import pytest
from amaranth import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out
from numpy.typing import NDArray

from hdl.blocks.vectors import Block, of_stream
from hdl.selection.level_scan import WARNING_BEATS, LevelScan
from hdl.streams import beat
from sim.benches.rows import check

LAG_PX, BORDER_PX, CELL_LOG2 = 4, 7, 4


class ScanWithWarning(wiring.Component):
    """A scan whose warning is another mark of its beats."""

    def __init__(self, *, cells: bool, pixels_per_clock: int) -> None:
        self.scan = LevelScan(lag_px=LAG_PX, border_px=BORDER_PX, cells=cells, pixels_per_clock=pixels_per_clock)
        self.pixels_per_clock, self.latency_cycles = pixels_per_clock, self.scan.latency_cycles
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


def scanned(shape: tuple[int, int], marks: list[dict[str, NDArray[Any]]], dut: Any) -> Block:
    """A row whose frames have these marks at the position of each beat."""
    height_px, width_px = shape
    places = [{"x": x, "y": y} for y in range(height_px) for x in range(0, width_px, dut.pixels_per_clock)]
    values = [{name: plane.ravel().tolist() for name, plane in each.items()} for each in marks]
    answers = [at | {name: each[name][n] for name in each} for each in values for n, at in enumerate(places)]
    sizes = {"i_width_px": width_px, "i_height_px": height_px, "i_cell_log2": CELL_LOG2}
    return of_stream(dut, "", places * len(marks), answers, **sizes)


@pytest.mark.parametrize(
    ("pixels_per_clock", "shape", "cells"),
    # With two cell rows, and with the end of a second one in the border.
    [(1, (41, 27), True), (2, (37, 51), True), (1, (25, 27), False)],
)
def test_marks_belong_to_the_lagging_pixel(pixels_per_clock: int, shape: tuple[int, int], cells: bool) -> None:
    height_px, width_px = shape
    y, x = np.indices(shape) - LAG_PX
    inside = (x >= BORDER_PX) & (x < width_px - BORDER_PX) & (y >= BORDER_PX) & (y < height_px - BORDER_PX)
    beats_left = (width_px - 1) // pixels_per_clock - (x + LAG_PX) // pixels_per_clock
    line_ends, lowest = beats_left == 0, height_px - 1 - BORDER_PX
    cell_ends = cells & (y >= 0) & (y % (1 << CELL_LOG2) == (1 << CELL_LOG2) - 1) & (y < lowest)
    closes = cell_ends | (y == lowest)
    # Of two pixels of a beat the left one has the lower bit; the marks are at its position.
    padded = np.pad(inside, ((0, 0), (0, width_px % pixels_per_clock)))
    marks = {
        "inside": np.sum([padded[:, n::pixels_per_clock] << n for n in range(pixels_per_clock)], axis=0),
        "ends_row": (line_ends & closes)[:, ::pixels_per_clock],
        "ends_level": (line_ends & (y == lowest))[:, ::pixels_per_clock],
        "row_closes": (closes & (beats_left > 0) & (beats_left <= WARNING_BEATS))[:, ::pixels_per_clock],
    }
    # During the first frame the sizes are still new.
    dut = ScanWithWarning(cells=cells, pixels_per_clock=pixels_per_clock)
    check(scanned(shape, [{}, marks, marks], dut))


def test_a_border_wider_than_the_smallest_level_still_ends_it() -> None:
    shape = (32, 32)
    dut = LevelScan(lag_px=LAG_PX, border_px=60, cells=True)
    end = np.zeros(shape, int)
    end[0, -1] = 1
    check(scanned(shape, [{}, {"inside": 0 * end, "ends_row": end, "ends_level": end}], dut))
