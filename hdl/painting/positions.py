"""Positions of a tile's pixels in the frame, by adders alone."""

from typing import NamedTuple

from amaranth import Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.corners import CELL_PX, CORNER, SIDE
from golden_model.painting.positions import CELL_LOG2, EDGE_BITS, EXACT_BITS, POSITION
from golden_model.painting.tiles import TILE_PX
from golden_model.painting.windows import WINDOW_PX
from hdl.lib.add_subtract import add_or_subtract
from hdl.painting.corners import CORNERS

SOURCE = {"window": 1, "wide": 1, "blank": 1}
"""The window that holds a part of the frame: one of two, or a ``wide`` one. Where ``blank``, nothing of it is shown."""
POSITION_PAYLOAD = data.StructLayout({"x": signed(POSITION.bits), "y": signed(POSITION.bits)} | SOURCE)
"""A position in the frame, and where its surroundings are; a ``blank`` one is outside, whatever x and y are."""
LOADED_TILE = data.StructLayout({"corners": CORNERS} | SOURCE)
"""A tile, and where its part of the frame is."""
ROUNDING = 1 << EDGE_BITS - POSITION.fraction_bits - 1
"""Half a step of a position, on an edge; edges carry it to all positions between them."""
SPAN_BITS = WINDOW_PX.bit_length()
"""Bits of the whole pixels between two corners, with the sign."""
DOWN_COLUMN = TILE_PX * 3 // 4
"""Where the edges move on to the next row: in the second cell, when this row needs them no more."""


class _Moves(NamedTuple):
    """What happens in a clock."""

    loads: Signal
    """The edges begin at the upper corners."""
    begins: Signal
    """A row begins."""
    goes_right: Signal
    changes_cell: Signal
    goes_down: Signal
    is_right: Signal
    """The position is in the right cell."""
    is_lower: Signal
    """The row is in the lower cells."""
    ends: Signal
    """The tile ends."""


class Positions(wiring.Component):
    """Walks through a tile row by row; equal to `golden_model.painting.positions`.

    The edges of cells move down by a difference of corners per row, and a position moves right by a difference of edges
    per pixel. Neither drops a bit: the position is rounded once.

    A tile takes 1026 clocks while positions are taken at once: two, then one for each position.
    """

    i: In(stream.Signature(LOADED_TILE))
    """Its corners are less than 128 px apart, unless it is blank. Taken together with its last position."""
    o: Out(stream.Signature(POSITION_PAYLOAD))
    """Positions of 32 x 32 pixels, row by row."""

    latency_cycles = 2
    """From a tile to its first position."""

    def elaborate(self, platform: object) -> Module:
        """Count columns and rows."""
        m = Module()
        column = Signal(range(TILE_PX))
        row = Signal(range(TILE_PX))
        ends_row = column == TILE_PX - 1
        moves = _Moves(*(Signal(name=name) for name in _Moves._fields))
        m.d.comb += [
            moves.changes_cell.eq(moves.goes_right & (column == CELL_PX - 1)),
            moves.goes_down.eq(moves.goes_right & (column == DOWN_COLUMN)),
            moves.is_right.eq(column >= CELL_PX),
            moves.is_lower.eq(row >= CELL_PX),
            moves.ends.eq(self.i.ready),
        ]
        with m.FSM():
            with m.State("Load"):
                m.d.comb += moves.loads.eq(self.i.valid)
                with m.If(self.i.valid):
                    m.next = "Start"
            with m.State("Start"):
                m.d.comb += moves.begins.eq(1)
                m.d.sync += self.o.valid.eq(1)
                m.next = "Walk"
            with m.State("Walk"), m.If(self.o.ready):
                m.d.comb += [moves.goes_right.eq(1), moves.begins.eq(ends_row)]
                m.d.sync += [column.eq(column + 1), row.eq(row + ends_row)]
                with m.If(ends_row & (row == TILE_PX - 1)):
                    m.d.comb += self.i.ready.eq(1)
                    m.d.sync += self.o.valid.eq(0)
                    m.next = "Load"
        tile, position = self.i.payload, self.o.payload
        m.d.comb += [position[name].eq(tile[name]) for name in SOURCE]
        for axis in ("x", "y"):
            m.d.comb += position[axis].eq(self._walk(m, axis, moves, self._follow_edges(m, axis, moves)))
        return m

    def _follow_edges(self, m: Module, axis: str, moves: _Moves) -> list[Signal]:
        """Where a row of pixels meets the edges of cells, left to right."""
        edges = []
        for n in range(SIDE):
            top, middle, bottom = (self.i.payload.corners[row * SIDE + n][axis] for row in range(SIDE))
            # One operand is always the same, and the sign follows in the next adder, or tools would need more logic.
            distance = Signal(signed(CORNER.fraction_bits + SPAN_BITS), name=f"{axis}_distance{n}", reset_less=True)
            m.d.sync += distance.eq(middle - Mux(moves.is_lower, bottom, top))
            edge = Signal(signed(POSITION.integer_bits + EDGE_BITS), name=f"{axis}_edge{n}", init=ROUNDING)
            with m.If(moves.loads | moves.goes_down):
                way = Mux(moves.loads, top << CELL_LOG2, distance)
                m.d.sync += edge.eq(add_or_subtract(edge, way, moves.is_lower))
            with m.If(moves.ends):
                m.d.sync += edge.eq(ROUNDING)
            edges.append(edge)
        return edges

    @staticmethod
    def _walk(m: Module, axis: str, moves: _Moves, edges: list[Signal]) -> Value:
        """Walk from edge to edge; the middle one is reached exactly, and only the step changes there."""
        left, middle, right = edges
        step = Signal(signed(EDGE_BITS + SPAN_BITS), name=f"{axis}_step", reset_less=True)
        exact = Signal(signed(POSITION.integer_bits + EXACT_BITS), name=f"exact_{axis}", reset_less=True)
        with m.If(moves.begins | moves.changes_cell):
            m.d.sync += step.eq(middle - Mux(moves.begins, left, right))
        with m.If(moves.begins | moves.goes_right):
            onwards = add_or_subtract(exact, step, moves.is_right)
            m.d.sync += exact.eq(Mux(moves.begins, left << CELL_LOG2, onwards))
        return exact[EXACT_BITS - POSITION.fraction_bits :]
