"""Which tiles of the canvas a frame touches: every tile is tried, one a clock."""

from amaranth import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MAX_FRAME_PX
from golden_model.painting.pose import ELEMENT, UNIT_LOG2
from golden_model.painting.tiles import MAX_TILES, SLACK, TESTED, UNIT_TILES
from hdl.lib.add_subtract import add_or_subtract
from hdl.lib.delay import delayed
from hdl.lib.multiplier import Multiplier, multiply
from hdl.lib.views import view_signal
from hdl.painting.pose import COLUMN

FRAME_SIDE = range(MAX_FRAME_PX + 1)
"""Width or height of a frame, px."""
TILE = data.StructLayout({"column": range(MAX_TILES), "row": range(MAX_TILES)})
COEFFICIENT = signed(TESTED.bits + 1)
"""Of an edge: a difference of two elements."""
VALUE = signed(COEFFICIENT.width + (3 * MAX_TILES).bit_length())
"""Three coefficients, each times `MAX_TILES` at most."""
COEFFICIENT_CYCLES = Multiplier.latency_cycles + 1
"""From a column of a pose to the edges' coefficients."""
STEP = data.StructLayout({"clear": 1, "shift": 1, "add": 1, "y": 1, "subtract": 1, "favour": 1})
"""What all edges do in a clock; see `EdgeValue`."""


class TileWalker(wiring.Component):
    """The tiles that a frame may touch; equal to `golden_model.painting.tiles.touched`.

    The way leads from left to right and back again, so that each step adds a coefficient to the value of an edge, or
    subtracts it, and no row needs a start of its own. A tile of the canvas takes a clock; one that is offered waits
    until it is taken.
    """

    i: In(stream.Signature(COLUMN))
    """Poses. The next one is taken when all tiles of the last one have been."""
    i_width_px: In(FRAME_SIDE)
    i_height_px: In(FRAME_SIDE)
    """Size of the frame; this and what follows stays while a pose is in work."""
    i_columns: In(range(MAX_TILES + 1))
    i_rows: In(range(MAX_TILES + 1))
    """Size of the canvas, in tiles, at least 1."""
    i_replace: In(1)
    """Every tile of the canvas is offered."""
    o: Out(stream.Signature(TILE))
    o_idle: Out(1)
    """No pose is in work."""

    # Each column settles; the first is added `UNIT_TILES` times; the best corner is favoured in x and y.
    setup_cycles = 3 * (COEFFICIENT_CYCLES + 1) + UNIT_TILES + 2
    """From the first column, where the others wait, to the first tile."""

    def elaborate(self, platform: object) -> Module:
        """The edges' values follow the way."""
        m = Module()
        step = view_signal(STEP)
        inside: list[Value] = []
        for n, coefficient in enumerate(self._coefficients(m)):
            m.submodules[f"edge{n}"] = edge = EdgeValue()
            m.d.comb += [edge.i_coefficient.eq(coefficient), edge.i_step.eq(step)]
            inside.append(edge.o_inside)
        walks = Signal()
        moves = Signal()
        m.d.comb += [
            self.o.valid.eq(walks & (Cat(inside).all() | self.i_replace)),
            moves.eq(walks & (~self.o.valid | self.o.ready)),
        ]
        ends_row, leftwards = self._count(m, moves)
        is_last = ends_row & (self.o.payload.row + 1 == self.i_rows)
        self._lead(m, step, walks, moves & is_last)
        with m.If(walks):
            m.d.comb += [step.add.eq(moves), step.y.eq(ends_row), step.subtract.eq(leftwards & ~ends_row)]
        return m

    def _lead(self, m: Module, step: data.View, walks: Signal, ends: Value) -> None:
        """Take a pose's columns in turn, find the values at the first tile, and walk."""
        columns = Signal(range(3))
        added = Signal(range(UNIT_TILES))
        settled = delayed(m, self.i.valid & self.i.ready, COEFFICIENT_CYCLES, reset_less=False)
        m.d.comb += step.shift.eq(settled)
        with m.FSM():
            with m.State("take"):
                m.d.comb += [self.i.ready.eq(1), self.o_idle.eq(columns == 0), step.clear.eq(self.o_idle)]
                with m.If(self.i.valid):
                    m.next = "settle"
            with m.State("settle"), m.If(settled):
                m.d.sync += columns.eq(Mux(columns == 2, 0, columns + 1))
                with m.Switch(columns):
                    with m.Case(0):
                        m.next = "add constant"
                    with m.Case(1):
                        m.next = "take"
                    with m.Default():
                        m.next = "favour x"
            with m.State("add constant"):
                m.d.comb += [step.add.eq(1), step.y.eq(1)]
                m.d.sync += added.eq(added + 1)
                with m.If(added == UNIT_TILES - 1):
                    m.next = "take"
            with m.State("favour x"):
                m.d.comb += [step.add.eq(1), step.favour.eq(1)]
                m.next = "favour y"
            with m.State("favour y"):
                m.d.comb += [step.add.eq(1), step.favour.eq(1), step.y.eq(1)]
                m.next = "walk"
            with m.State("walk"):
                m.d.comb += walks.eq(1)
                with m.If(ends):
                    m.next = "take"

    def _count(self, m: Module, moves: Value) -> tuple[Signal, Signal]:
        """Count columns and rows; whether this tile is the last of its row, and whether the way leads to the left."""
        column, row = Signal(range(MAX_TILES)), Signal(range(MAX_TILES))
        left = Signal(range(MAX_TILES))
        ends_row, leftwards = Signal(), Signal()
        m.d.comb += [self.o.payload.column.eq(column), self.o.payload.row.eq(row)]
        with m.If(self.o_idle | (moves & ends_row)):
            m.d.sync += [left.eq(self.i_columns - 1), ends_row.eq(self.i_columns == 1)]
        with m.Elif(moves):
            m.d.sync += [left.eq(left - 1), ends_row.eq(left == 1), column.eq(Mux(leftwards, column - 1, column + 1))]
        with m.If(self.o_idle):
            m.d.sync += [column.eq(0), row.eq(0), leftwards.eq(0)]
        with m.Elif(moves & ends_row):
            m.d.sync += [row.eq(row + 1), leftwards.eq(~leftwards)]
        return ends_row, leftwards

    def _coefficients(self, m: Module) -> list[Value]:
        """Compute what `golden_model.painting.tiles.edges` does, for a column."""
        # Cut, and not shifted, so that w fits the multiplier of any technology.
        x, y, w = (self.i.payload[name][ELEMENT.bits - TESTED.bits :].as_signed() for name in "xyw")
        sides = [
            multiply(m, name, w, Cat(side, Const(0, 1)).as_signed()) >> UNIT_LOG2
            for name, side in (("width", self.i_width_px), ("height", self.i_height_px))
        ]
        x, y, w = (delayed(m, each, Multiplier.latency_cycles) for each in (x, y, w))
        margin = w >> UNIT_LOG2
        results = (x + margin, sides[0] - x, y + margin, sides[1] - y, w)
        return [delayed(m, each, 1) for each in results]


class EdgeValue(wiring.Component):
    """A linear function of column and row, at the corner of a tile where it is largest.

    A step clears the value, shifts a coefficient in, or adds one of the last two. For the first column of a pose only
    one is there, the newest, which afterwards is that of y.
    """

    i_coefficient: In(COEFFICIENT)
    i_step: In(STEP)
    o_inside: Out(1)

    def elaborate(self, platform: object) -> Module:
        """One adder, two coefficients."""
        m = Module()
        step = self.i_step
        x, y = Signal(COEFFICIENT, reset_less=True), Signal(COEFFICIENT, reset_less=True)
        value = Signal(VALUE, reset_less=True)
        with m.If(step.shift):
            m.d.sync += [x.eq(y), y.eq(self.i_coefficient)]
        chosen = Mux(step.y, y, x)
        with m.If(step.clear):
            m.d.sync += value.eq(SLACK)
        with m.Elif(step.add & ~(step.favour & (chosen < 0))):
            m.d.sync += value.eq(add_or_subtract(value, chosen, step.subtract))
        m.d.comb += self.o_inside.eq(value >= 0)
        return m
