"""What a level's scan position means: whether a feature may be there, and whether a cell row ends."""

from __future__ import annotations

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import CELL_SIZES_PX, MAX_FRAME_PX, MIN_FRAME_PX
from hdl.lib.delay import delayed
from hdl.streams import COORDINATE, beat, carry_scan

SPARE_LINES = 2
WARNING_PX = 24
"""How early the end of a cell row is foretold: by less than the smallest level's width."""
SMALLEST_LEVEL_PX = MIN_FRAME_PX // 2


class LevelScan(wiring.Component):
    """Marks of each beat: they belong to the pixel ``lag_px`` left of and above the scan position.

    A cell row ends with the scan line that holds the last pixels of its lowest line, the level with the line of its
    lowest feature. So nothing waits for lines below the frame.

    Parameters
    ----------
    lag_px : int
    border_px : int
        Features keep this distance from the border; at least ``lag_px`` + 2, so that two lines are left for the last
        features to be counted before the next frame starts.
    cells : bool
        Whether there are cell rows; otherwise the level is one row.

    Members
    -------
    i : In(beat(pixel))
        Only its scan position matters.
    i_width_px, i_height_px : In
        Of the level, at least 32. Static from 1 clock before a frame's first beat.
    i_cell_log2 : In(4)
        log2 of the cell's side, 5 to 8.
    o : Out(beat(inside, ends_row, ends_level))
        A feature may be at the pixel; a cell row has passed; the level has.
    o_row_closes : Out(1)
        The beat that came last is one of the last ``WARNING_PX`` before the end of a cell row.

    Attributes
    ----------
    latency_cycles : int

    Raises
    ------
    ValueError
        For too small a border.
    """

    i: data.View
    i_width_px: Signal
    i_height_px: Signal
    i_cell_log2: Signal
    o: data.View
    o_row_closes: Signal

    latency_cycles = 3

    def __init__(self, *, lag_px: int, border_px: int, cells: bool) -> None:
        if border_px < lag_px + SPARE_LINES:
            raise ValueError(
                f"border_px is {border_px}; with this detector and descriptor the hardware needs {lag_px + SPARE_LINES}"
            )
        self.lag_px = lag_px
        self.border_px = border_px
        self.cells = cells
        super().__init__(
            {
                "i": In(beat(pixel=8)),
                "i_width_px": In(range(MAX_FRAME_PX + 1)),
                "i_height_px": In(range(MAX_FRAME_PX + 1)),
                "i_cell_log2": In(4),
                "o": Out(beat(inside=1, ends_row=1, ends_level=1)),
                "o_row_closes": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Compare the position with numbers that only settings change, then combine."""
        m = Module()
        last_x, lowest_y = Signal(COORDINATE), Signal(COORDINATE)
        right_px, bottom_px = Signal.like(self.i_width_px), Signal.like(self.i_height_px)
        warning_x = Signal(COORDINATE)
        cell_mask = Signal(max(CELL_SIZES_PX).bit_length() - 1)
        spare_px = self.border_px - self.lag_px
        m.d.sync += [
            last_x.eq(self.i_width_px - 1),
            warning_x.eq(self.i_width_px - 1 - WARNING_PX),
            right_px.eq(Mux(self.i_width_px > spare_px, self.i_width_px - spare_px, 0)),
            bottom_px.eq(Mux(self.i_height_px > spare_px, self.i_height_px - spare_px, 0)),
            # Above the frame's last line by so much that no feature is lost, and that even the smallest level has it.
            lowest_y.eq(self.i_height_px - 1 - min(spare_px, SMALLEST_LEVEL_PX - 1)),
            cell_mask.eq((1 << self.i_cell_log2) - 1),
        ]
        x, y, first_px = self.i.x, self.i.y, self.border_px + self.lag_px
        limits = (x >= first_px, y >= first_px, x < right_px, y < bottom_px)
        inside = delayed(m, delayed(m, Cat(limits), 1).all(), 1)
        line_ends, line_ends_soon = delayed(m, x == last_x, 2), delayed(m, x >= warning_x, 2)
        is_lowest, is_above = delayed(m, y == lowest_y, 2), delayed(m, y < lowest_y, 2)
        cell_ends: Value = Const(0)
        if self.cells:
            # The line below the pixel's is a cell's first.
            line_below, exists = delayed(m, y - (self.lag_px - 1), 1), delayed(m, y >= self.lag_px, 1)
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
