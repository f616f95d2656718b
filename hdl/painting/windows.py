"""Decides which tiles are painted, and which part of the frame they need."""

from amaranth import Array, Cat, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.blending import FADE
from golden_model.painting.corners import CORNER
from golden_model.painting.positions import POSITION
from golden_model.painting.sampling import WEIGHT_BITS
from golden_model.painting.windows import NARROW_PX, WINDOW_PX
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.painting.corners import CORNERS, PROJECTED
from hdl.painting.sampling import WEIGHING_CYCLES, smaller, weigh, weight_shift
from hdl.painting.tiles import FRAME_SIDE, TILE
from hdl.streams import COORDINATE

BOX = ("left", "top", "right", "bottom")
PLAN = data.StructLayout(
    {"tile": TILE, "corners": CORNERS, **dict.fromkeys(BOX, COORDINATE), "wide": 1, "painted": 1, "blank": 1}
)
"""A tile to paint, and the part of the frame that it needs: inclusive, inside the frame, at most 128 x 128 px.

``wide``: it is wider than 64 px, so that its window has no other beside it.
``painted``: the tile was painted before, so that its memory has a meaning. ``blank``: nothing of the frame is to be
shown; corners and box mean nothing.
"""
PAINTED_TILE = data.StructLayout({"valid": 1, "tile": TILE, "least": WEIGHT_BITS, "painted": 1})
"""A tile that has been painted, and the smallest weight in it. Not ``painted``: what is in memory means nothing yet."""
_KEPT = data.StructLayout({"least": WEIGHT_BITS, "painted": 1})
PLACE_BITS = TILE["column"].width
"""Bits of the columns, and of the rows, for which the planner has memory."""
WHOLE = signed(CORNER.integer_bits + 1)
"""Whole pixels: a corner may be rounded up beyond its format."""
HALF_POSITION = 1 << CORNER.fraction_bits - POSITION.fraction_bits - 1
COORDINATES = 2 * CORNERS.length
BOX_STEP = COORDINATES + 2
"""The box is known along x, and in the next step along y."""
DISTANCE_STEP = BOX_STEP + 4
"""The distance of its farthest pixel to the border is known."""
JUDGE_STEP = DISTANCE_STEP + WEIGHING_CYCLES + 1
"""And so is whether it can win."""


class WindowPlanner(wiring.Component):
    """Plans the window of each tile; equal to `golden_model.painting.windows`.

    Tiles that need more than a window has, that are not wholly in front of the camera, or that could not change the
    canvas, are dropped. With ``i_replace`` none is dropped: the first two become blank, as those outside the frame.

    For each tile of the canvas a memory keeps the smallest weight, and whether the tile was ever painted. It is cleared
    after a reset and by ``i_clear``, a tile per clock; tiles wait until then.

    A tile takes 28 clocks, the last of them that in which the plan is taken.
    """

    i: In(stream.Signature(PROJECTED))
    """Taken together with its plan: corners are not stored. A tile may come again when it has been painted."""
    i_painted: In(PAINTED_TILE)
    """Not while the memory is cleared."""
    i_width_px: In(FRAME_SIDE)
    """Size of the frame; constant while it is painted."""
    i_height_px: In(FRAME_SIDE)
    i_replace: In(1)
    """Nothing on the canvas stays; constant while a frame is painted."""
    i_clear: In(1)
    """Forget what was painted; while no tile is inside."""
    o: Out(stream.Signature(PLAN))
    o_behind: Out(1)
    """A tile is dropped, or with ``i_replace`` blank, because it is not wholly in front of the camera."""
    o_too_large: Out(1)
    """A tile is dropped, or with ``i_replace`` blank, because its window would be too large."""
    o_cannot_win: Out(1)
    """A tile is dropped because it would not change the canvas."""
    o_clearing: Out(1)
    """The memory is being cleared."""

    latency_cycles = JUDGE_STEP
    """From a tile to its plan."""

    def elaborate(self, platform: object) -> Module:
        """Take a coordinate of a corner per clock, x and y in turns; then judge the box around them."""
        m = Module()
        step = Signal(range(JUDGE_STEP + 1))
        kept = self._keep(m)
        least, most = self._measure(m, step)
        # Known a step before it is needed.
        last = delayed(m, Mux(step[0], self.i_width_px, self.i_height_px) - 1, 1)
        is_large = self._cut(m, step, least, most, last)
        nearer = smaller(m, delayed(m, most, 1), delayed(m, last - least, 1))
        other = delayed(m, nearer, 1)
        distance = Signal(WHOLE, reset_less=True)
        with m.If(step == DISTANCE_STEP - 1):
            m.d.sync += distance.eq(Mux(nearer < other, nearer, other))
        weight = weigh(m, distance, weight_shift(m, self.i_width_px, self.i_height_px))
        is_outside = delayed(m, weight == 0, 1)
        wins = delayed(m, (weight != 0) & (weight + (FADE >> 1) > kept.least), 1)
        tile, plan = self.i.payload, self.o.payload
        m.d.comb += [
            plan.tile.eq(tile.tile),
            plan.corners.eq(tile.corners),
            plan.painted.eq(kept.painted),
            plan.blank.eq(tile.behind | is_large | is_outside),
        ]
        self._judge(m, step, is_large, wins)
        return m

    def _judge(self, m: Module, step: Signal, is_large: Value, wins: Value) -> None:
        """Count steps; in the last one offer the plan, or drop the tile."""
        behind = self.i.payload.behind
        drops = ~self.i_replace & (behind | is_large | ~wins)
        judges, ends = Signal(), self.i.ready
        m.d.comb += [
            judges.eq(self.i.valid & ~self.o_clearing & (step == JUDGE_STEP)),
            self.o.valid.eq(judges & ~drops),
            ends.eq(judges & (drops | self.o.ready)),
            self.o_behind.eq(ends & behind),
            self.o_too_large.eq(ends & ~behind & is_large),
            self.o_cannot_win.eq(ends & drops & ~behind & ~is_large),
        ]
        with m.If(ends):
            m.d.sync += step.eq(0)
        with m.Elif(self.i.valid & ~self.o_clearing & ~judges):
            m.d.sync += step.eq(step + 1)

    def _keep(self, m: Module) -> data.View:
        """What the memory says of the tile at the input."""
        m.submodules.tiles = tiles = LineMemory(shape=_KEPT, depth=1 << 2 * PLACE_BITS)
        painted, cleared = self.i_painted, Signal(2 * PLACE_BITS)
        clears = Signal(init=1)
        word = data.View(_KEPT, tiles.i_word)
        m.d.comb += [
            self.o_clearing.eq(clears),
            tiles.i_read.eq(1),
            tiles.i_read_address.eq(self._address(self.i.payload.tile)),
            tiles.i_write.eq(painted.valid | clears),
            tiles.i_write_address.eq(Mux(clears, cleared, self._address(painted.tile))),
            word.painted.eq(~clears & painted.painted),
            word.least.eq(Mux(clears, 0, painted.least)),
        ]
        m.d.sync += [cleared.eq(cleared + clears), clears.eq(self.i_clear | (clears & ~cleared.all()))]
        return data.View(_KEPT, tiles.o_word)

    @staticmethod
    def _address(tile: data.View) -> Value:
        return Cat(tile.column[:PLACE_BITS], tile.row[:PLACE_BITS])

    def _measure(self, m: Module, step: Signal) -> tuple[Value, Value]:
        """First and last pixel that a tile needs, along x and along y in turns."""
        coordinates = Array(corner[axis] for corner in self.i.payload.corners for axis in "xy")
        coordinate = delayed(m, coordinates[step], 1)
        nearest = delayed(m, (coordinate + HALF_POSITION) >> CORNER.fraction_bits, 1)
        is_first = delayed(m, step < 2, 2)
        is_coordinate = delayed(m, step < COORDINATES, 2)
        sides = []
        for name in ("least", "most"):
            # That of this coordinate's axis; the other one's is in `waiting`, before it is chosen.
            side = Signal(WHOLE, name=name, reset_less=True)
            waiting = delayed(m, side, 1)
            exceeds, pixel = (nearest < side, nearest) if name == "least" else (nearest >= side, nearest + 1)
            moves, moved = delayed(m, is_coordinate & (is_first | exceeds), 1), delayed(m, pixel, 1)
            m.d.sync += side.eq(Mux(moves, moved, waiting))
            sides.append(side)
        least, most = sides
        return least, most

    def _cut(self, m: Module, step: Signal, least: Value, most: Value, last: Value) -> Value:
        """Cut the box to the frame and give it to the plan; return whether it is too large."""
        plan = self.o.payload
        left, top, right, bottom = (Signal(COORDINATE, name=name, reset_less=True) for name in BOX)
        large = Signal(2, reset_less=True)
        wide = delayed(m, right - left >= NARROW_PX, 1)
        span_px = delayed(m, most - least, 1)
        # What is taken along x moves on when that along y comes.
        with m.If((step == BOX_STEP) | (step == BOX_STEP + 1)):
            m.d.sync += [
                Cat(left, top).eq(Cat(top, Mux(least < 0, 0, least)[: len(top)])),
                Cat(right, bottom).eq(Cat(bottom, Mux(most > last, last, most)[: len(bottom)])),
            ]
        with m.If((step == BOX_STEP + 1) | (step == BOX_STEP + 2)):
            m.d.sync += large.eq(Cat(large[1], span_px >= WINDOW_PX))
        m.d.comb += [plan[name].eq(side) for name, side in zip(BOX, (left, top, right, bottom), strict=True)]
        m.d.comb += plan.wide.eq(wide & ~plan.blank)
        return large.any()
