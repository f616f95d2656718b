"""Where the corners of a tile's cells lie in the frame: sums that walk along the tiles, and two serial dividers."""

from amaranth import Cat, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.corners import CORNER as CORNER_FORMAT
from golden_model.painting.corners import SIDE, SUM_SHIFT
from golden_model.painting.pose import ELEMENT, UNIT_LOG2
from golden_model.painting.tiles import MAX_TILES
from hdl.lib.add_subtract import add_or_subtract
from hdl.lib.views import view_signal
from hdl.painting.pose import COLUMN
from hdl.painting.tiles import TILE

STEP = data.StructLayout({"clear": 1, "shift": 1, "add": 1, "y": 1, "subtract": 1})
"""What the sums do in a clock: take a column of the pose, or add the newer one (y) or the older one (x)."""
CORNER = data.StructLayout({name: signed(CORNER_FORMAT.bits) for name in "xy"})
"""`golden_model.painting.corners.CORNER`, px."""
CORNERS = data.ArrayLayout(CORNER, SIDE**2)
PROJECTED = data.StructLayout({"tile": TILE, "corners": CORNERS, "behind": 1})
"""A tile with its corners, row by row. ``behind``: one is not in front of the horizon, or does not fit `CORNER`; then
the corners mean nothing."""

CONSTANT_STEPS = 1 << SUM_SHIFT
"""The constant column counts for as many cells, 4096 px."""
SUM = signed(ELEMENT.bits + SUM_SHIFT + 2)
"""Three elements, each times 256 at most."""
DIVIDEND = signed(SUM.width - SUM_SHIFT)
CELLS = SIDE - 1
"""Along each side of a tile."""
DISTANCE = signed((CELLS * MAX_TILES).bit_length() + 1)
"""Cells between two corners of the canvas."""
QUOTIENT_BITS = CORNER_FORMAT.bits + 1
"""One more than is needed, so that a quotient that does not fit is seen."""
DIVISOR_SHIFT = QUOTIENT_BITS - 1 - UNIT_LOG2 - CORNER_FORMAT.fraction_bits
"""A quotient of integers with 23 bits after the point, divided by 2^3, is one with 20."""
REMAINDER = signed(DIVIDEND.width + DIVISOR_SHIFT + 1)


class CornerSums(wiring.Component):
    """x, y and w of a pose at a corner of the canvas's cells, from which it goes to others.

    A pose begins at the origin and takes 260 clocks; afterwards each cell of a way takes one.
    """

    i_pose: In(stream.Signature(COLUMN))
    """Not taken on the way."""
    i_go: In(1)
    """Begins a way; not on another."""
    i_x: In(DISTANCE)
    i_y: In(DISTANCE)
    """Cells to go."""
    o_loaded: Out(1)
    """There is a whole pose."""
    o_arrived: Out(1)
    """From the clock after ``i_go``: the sums are those of the way's end. Not while a pose is loaded."""
    o: Out(data.ArrayLayout(DIVIDEND, 3))

    def elaborate(self, platform: object) -> Module:
        """Three adders, the two last columns, and the steps that are left."""
        m = Module()
        step = view_signal(STEP)
        self._load(m, step)
        is_on_way = self._walk(m, step)
        # A register before the adders, or deciding and adding would limit the clock.
        decided = view_signal(STEP)
        m.d.sync += decided.eq(step)
        m.d.comb += self.o_arrived.eq(self.o_loaded & ~is_on_way & ~decided.add)
        for name, result in zip("xyw", self.o, strict=True):
            factors = [Signal(signed(ELEMENT.bits), name=f"{name}_{n}", reset_less=True) for n in range(2)]
            total = Signal(SUM, name=f"{name}_sum", reset_less=True)
            with m.If(step.shift):
                m.d.sync += [factors[0].eq(factors[1]), factors[1].eq(self.i_pose.payload[name])]
            with m.If(decided.clear):
                m.d.sync += total.eq(0)
            with m.Elif(decided.add):
                m.d.sync += total.eq(add_or_subtract(total, Mux(decided.y, factors[1], factors[0]), decided.subtract))
            m.d.comb += result.eq(total >> SUM_SHIFT)
        return m

    def _load(self, m: Module, step: data.View) -> None:
        """Add the first column `CONSTANT_STEPS` times, and keep the two others."""
        left = Signal(range(CONSTANT_STEPS + 1))
        columns = Signal(range(3))
        arrives = self.i_pose.valid & self.i_pose.ready
        m.d.comb += [self.i_pose.ready.eq(left == 0), step.shift.eq(arrives), step.clear.eq(arrives & (columns == 0))]
        with m.If(arrives):
            m.d.sync += [columns.eq(Mux(columns == 2, 0, columns + 1)), self.o_loaded.eq(columns == 2)]
            with m.If(columns == 0):
                m.d.sync += left.eq(CONSTANT_STEPS)
        with m.Elif(left != 0):
            m.d.comb += [step.add.eq(1), step.y.eq(1)]
            m.d.sync += left.eq(left - 1)

    def _walk(self, m: Module, step: data.View) -> Value:
        """First along x, then along y; whether there are cells to go."""
        x, y = Signal(DISTANCE), Signal(DISTANCE)
        with m.If(self.i_go):
            m.d.sync += [x.eq(self.i_x), y.eq(self.i_y)]
        with m.Elif(x != 0):
            m.d.comb += [step.add.eq(1), step.subtract.eq(x < 0)]
            m.d.sync += x.eq(x + Mux(x < 0, 1, -1))
        with m.Elif(y != 0):
            m.d.comb += [step.add.eq(1), step.y.eq(1), step.subtract.eq(y < 0)]
            m.d.sync += y.eq(y + Mux(y < 0, 1, -1))
        return Value.cast((x != 0) | (y != 0))


class SerialQuotient(wiring.Component):
    """``i_dividend`` 2^20 / ``i_divisor``, rounded down, a bit in a clock.

    This division does not restore: the divisor is added to a negative remainder, and subtracted from another. Where it
    was subtracted, the quotient has a 1.
    """

    i_start: In(1)
    i_dividend: In(DIVIDEND)
    i_divisor: In(DIVIDEND)
    """From the clock after ``i_start`` on, until the quotient is there."""
    o: Out(signed(CORNER_FORMAT.bits))
    """`latency_cycles` after ``i_start``, in this clock only."""
    o_fits: Out(1)
    """Whether it is the quotient. It never is for a divisor of 0 or less, of which the two first bits are equal."""

    latency_cycles = 1 + QUOTIENT_BITS

    def elaborate(self, platform: object) -> Module:
        """One adder, and a register for the quotient's bits."""
        m = Module()
        remainder = Signal(REMAINDER, reset_less=True)
        bits = Signal(QUOTIENT_BITS, reset_less=True)
        is_negative = remainder[-1]
        divisor = (self.i_divisor << DIVISOR_SHIFT).as_signed()
        m.d.sync += bits.eq(Cat(~is_negative, bits))
        with m.If(self.i_start):
            m.d.sync += remainder.eq(self.i_dividend)
        with m.Else():
            m.d.sync += remainder.eq(add_or_subtract(remainder << 1, divisor, ~is_negative))
        # The bits stand for 1 and -1: the first one is inverted, and the lowest stands for itself.
        m.d.comb += [self.o.eq(bits[:-1]), self.o_fits.eq(bits[-1] != bits[-2])]
        return m


class CornerProjector(wiring.Component):
    """The corners of each tile; equal to `golden_model.painting.corners.project`.

    `CornerSums` goes to a corner while the corner before is divided. The order of `hdl.painting.tiles.TileWalker` makes
    the ways from tile to tile short; any other is legal.

    A pose takes 260 clocks; a tile `tile_cycles`, and two for each column and row from the last one beyond the next.
    """

    i_pose: In(stream.Signature(COLUMN))
    """Poses, taken between tiles. The first tile after it is that of the new pose."""
    i: In(stream.Signature(TILE))
    """Taken when there is a pose."""
    o: Out(stream.Signature(PROJECTED))
    """One for each tile."""

    tile_cycles = SIDE**2 * SerialQuotient.latency_cycles + 2
    """For a tile that begins where the one before ends."""

    def elaborate(self, platform: object) -> Module:
        """Go to nine corners, and divide x and y by w at each."""
        m = Module()
        m.submodules.sums = sums = CornerSums()
        m.submodules.x, m.submodules.y = quotients = SerialQuotient(), SerialQuotient()
        starts, divided = Signal(), Signal()
        self._lead(m, sums, starts, divided)
        x, y, w = sums.o
        divisor = Signal(DIVIDEND, reset_less=True)
        found: list[Value] = []
        for quotient, dividend in zip(quotients, (x, y), strict=True):
            m.d.comb += [quotient.i_start.eq(starts), quotient.i_dividend.eq(dividend), quotient.i_divisor.eq(divisor)]
            found.append(quotient.o)
        corners = Signal(len(Value.cast(self.o.payload.corners)), reset_less=True)
        behind = Signal(reset_less=True)
        m.d.comb += [Value.cast(self.o.payload.corners).eq(corners), self.o.payload.behind.eq(behind)]
        with m.If(self.i.ready):
            m.d.sync += behind.eq(0)
        with m.If(starts):
            m.d.sync += divisor.eq(w)
        with m.If(divided):
            m.d.sync += corners.eq(Cat(corners, *found)[len(Cat(found)) :])
            with m.If(~Cat(quotient.o_fits for quotient in quotients).all()):
                m.d.sync += behind.eq(1)
        return m

    def _lead(self, m: Module, sums: CornerSums, starts: Signal, divided: Signal) -> None:
        """Take a tile, visit its corners row by row, and wait for the last quotient."""
        tile = self.i.payload
        taken = view_signal(TILE, reset_less=True)
        # Where the sums are when a tile is taken: at the last corner of the one before, or at the origin.
        x, y = (Signal(range(CELLS * MAX_TILES + 1), name=f"from_{name}") for name in "xy")
        column, row = Signal(range(SIDE)), Signal(range(SIDE))
        ends_row = column == CELLS
        clocks = Signal(range(SerialQuotient.latency_cycles + 1))
        takes = self.i.valid & self.i.ready
        m.d.comb += [self.o.payload.tile.eq(taken), divided.eq(clocks == 1)]
        with m.If(starts):
            m.d.sync += clocks.eq(SerialQuotient.latency_cycles)
        with m.Elif(clocks != 0):
            m.d.sync += clocks.eq(clocks - 1)
        with m.FSM():
            with m.State("idle"):
                m.d.comb += [
                    self.i.ready.eq(sums.o_loaded),
                    sums.i_pose.payload.eq(self.i_pose.payload),
                    sums.i_pose.valid.eq(self.i_pose.valid & ~takes),
                    self.i_pose.ready.eq(sums.i_pose.ready & ~takes),
                    sums.i_go.eq(takes),
                    sums.i_x.eq(CELLS * tile.column - x),
                    sums.i_y.eq(CELLS * tile.row - y),
                ]
                with m.If(takes):
                    m.d.sync += [taken.eq(tile), x.eq(CELLS * (tile.column + 1)), y.eq(CELLS * (tile.row + 1))]
                    m.next = "visit"
                with m.Elif(self.i_pose.valid):
                    m.d.sync += [x.eq(0), y.eq(0)]
            with m.State("visit"):
                m.d.comb += [
                    starts.eq(sums.o_arrived & (clocks <= 1)),
                    sums.i_x.eq(Mux(ends_row, -CELLS, 1)),
                    sums.i_y.eq(ends_row),
                ]
                with m.If(starts):
                    m.d.sync += column.eq(Mux(ends_row, 0, column + 1))
                    with m.If(ends_row):
                        m.d.sync += row.eq(Mux(row == CELLS, 0, row + 1))
                    with m.If(ends_row & (row == CELLS)):
                        m.next = "wait"
                    with m.Else():
                        m.d.comb += sums.i_go.eq(1)
            with m.State("wait"), m.If(divided):
                m.next = "offer"
            with m.State("offer"):
                m.d.comb += self.o.valid.eq(1)
                with m.If(self.o.ready):
                    m.next = "idle"
