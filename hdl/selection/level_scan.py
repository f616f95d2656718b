"""Marks each scan position of a level: may a feature be there, and does a cell row end?"""

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.config import CELL_SIZES_PX, MAX_FRAME_PX, MIN_LEVEL_PX
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.streams import COORDINATE, beat, carry_scan

WARNING_BEATS = 24
"""How early the end of a cell row is announced; must be less than the width of the smallest level."""


class LevelScan(Component):
    """Marks each beat, for the pixel ``lag_px`` left of and above the scan position.

    A cell row ends with the scan line that completes its lowest line; the level ends with the scan line of its lowest
    possible feature. The last features of a frame therefore need no extra lines to flush them out.

    Parameters
    ----------
    lag_px : int
    border_px : int
        Features keep this distance from the border; at least
        `golden_model.config.FrontEndConfig.min_hardware_border_px`.
    cells : bool
        Whether there are cell rows; without them the level is a single row.
    """

    i: data.View
    """Beats of ``pixel``; only the scan position matters."""
    i_width_px: In(range(MAX_FRAME_PX + 1))
    """Width of the level, at least 32 px per pixel of a beat. Stable from one clock before a frame's first beat."""
    i_height_px: In(range(MAX_FRAME_PX + 1))
    """Height of the level, likewise."""
    i_cell_log2: In(4)
    """log2 of the cell's side, 5 to 8."""
    o: data.View
    """Beats of ``inside`` (a feature may be at the pixel; one bit per pixel of the beat), ``ends_row`` (the beat is the
    last of a cell row) and ``ends_level`` (it is the last of the level)."""
    o_row_closes: Out(1)
    """The latest beat is one of the last ``WARNING_BEATS`` before the end of a cell row."""

    latency_cycles = 3
    closing_lines: int
    """Lines from the one that ends the level to the last."""

    def __init__(self, *, lag_px: int, border_px: int, cells: bool, pixels_per_clock: int = 1) -> None:
        self.pixels_per_clock = pixels_per_clock
        self.lag_px = lag_px
        self.border_px = border_px
        self.cells = cells
        # As far above the last line as possible without losing a feature; the limit keeps it inside the smallest level.
        self.closing_lines = min(border_px - lag_px, MIN_LEVEL_PX - 1) + 1
        super().__init__(
            i=In(beat(pixels_per_clock, pixel=8)), o=Out(beat(inside=pixels_per_clock, ends_row=1, ends_level=1))
        )

    def elaborate(self, platform: object) -> Module:
        """Compare the position with registered limits, which only settings change; then combine the results."""
        m = Module()
        last_x = Signal(COORDINATE, reset_less=True)
        lowest_y = Signal(COORDINATE, reset_less=True)
        right_px = Signal.like(self.i_width_px, reset_less=True)
        bottom_px = Signal.like(self.i_height_px, reset_less=True)
        warning_x = Signal(COORDINATE, reset_less=True)
        cell_mask = Signal(max(CELL_SIZES_PX).bit_length() - 1, reset_less=True)
        spare_px = self.border_px - self.lag_px
        last_beat: Value = self.i_width_px - 1
        if self.pixels_per_clock == 2:
            last_beat = Cat(0, last_beat[1:])
        # Registered, because settings are stable during a frame and the subtractions need not share a clock with the
        # comparisons.
        m.d.sync += [
            last_x.eq(last_beat),
            warning_x.eq(last_beat - WARNING_BEATS * self.pixels_per_clock),
            right_px.eq(Mux(self.i_width_px > spare_px, self.i_width_px - spare_px, 0)),
            bottom_px.eq(Mux(self.i_height_px > spare_px, self.i_height_px - spare_px, 0)),
            lowest_y.eq(self.i_height_px - self.closing_lines),
            cell_mask.eq((1 << self.i_cell_log2) - 1),
        ]
        x, y, first_px = self.i.x, self.i.y, self.border_px + self.lag_px
        inside_each = []
        for n in range(self.pixels_per_clock):
            limits = (x >= first_px - n, y >= first_px, x < right_px - n, y < bottom_px)
            inside_each.append(delayed(m, delayed(m, Cat(limits), 1).all(), 1))
        inside = Cat(inside_each)
        line_ends = delayed(m, x == last_x, 2)
        line_ends_soon = delayed(m, x >= warning_x, 2)
        is_lowest = delayed(m, y == lowest_y, 2)
        is_above = delayed(m, y < lowest_y, 2)
        cell_ends: Value = Const(0)
        if self.cells:
            # A cell row ends where the line below the pixel is the first of a cell.
            line_below = delayed(m, y - (self.lag_px - 1), 1)
            exists = delayed(m, y >= self.lag_px, 1)
            cell_ends = delayed(m, exists & ~(line_below & cell_mask).any(), 1)
        row_closes = is_lowest | (is_above & cell_ends)
        carry_scan(m, self.i, self.o, self.latency_cycles)
        m.d.comb += [
            self.o.inside.eq(delayed(m, inside, 1)),
            self.o.ends_row.eq(delayed(m, line_ends & row_closes, 1)),
            self.o.ends_level.eq(delayed(m, line_ends & is_lowest, 1)),
        ]
        with m.If(delayed(m, self.i.valid, 2, reset_less=False)):
            m.d.sync += self.o_row_closes.eq(row_closes & line_ends_soon & ~line_ends)
        return m
