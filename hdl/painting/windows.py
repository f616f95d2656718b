"""Decides which tiles are painted, and which part of the frame they need."""

from amaranth import Array, Cat, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MAX_FRAME_PX, check_range
from golden_model.painting.blending import FADE
from golden_model.painting.corners import CORNER
from golden_model.painting.positions import POSITION
from golden_model.painting.sampling import WEIGHT_BITS
from golden_model.painting.windows import WINDOW_PX
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.painting.corners import CORNERS, PROJECTED
from hdl.painting.sampling import SIDE, WEIGHING_CYCLES, weigh, weight_shift
from hdl.painting.tiles import TILE

BOX_SIDE = range(MAX_FRAME_PX)
PLAN = data.StructLayout(
    {
        "tile": TILE,
        "corners": CORNERS,
        "left": BOX_SIDE,
        "top": BOX_SIDE,
        "right": BOX_SIDE,
        "bottom": BOX_SIDE,
        "painted": 1,
        "blank": 1,
    }
)
"""A tile to paint, and the part of the frame that it needs: inclusive, inside the frame, at most 64 x 64 px.

``painted``: the tile was painted before, so that its memory has a meaning. ``blank``: nothing of the frame is to be
shown; corners and box mean nothing.
"""
PAINTED_TILE = data.StructLayout({"valid": 1, "tile": TILE, "least": WEIGHT_BITS})
"""A tile that has been painted, and the smallest weight in it."""
_KEPT = data.StructLayout({"least": WEIGHT_BITS, "painted": 1})
PLACE_BITS = TILE["column"].width
WHOLE = signed(CORNER.integer_bits + 1)
"""Whole pixels: a corner may be rounded up beyond its format."""
HALF_POSITION = 1 << CORNER.fraction_bits - POSITION.fraction_bits - 1

BOX_CYCLES = 3
"""From a corner at the input to the box that holds it."""
LAST_CORNER = CORNERS.length - 1
JUDGE_STEP = LAST_CORNER + BOX_CYCLES + 1 + WEIGHING_CYCLES + 1
"""After the last corner's box: its size and distances; the largest weight; its comparison."""


class WindowPlanner(wiring.Component):
    """Plans the window of each tile; equal to `golden_model.painting.windows`.

    Tiles that need more than a window has, that are not wholly in front of the camera, or that could not change the
    canvas, are dropped. With ``i_replace`` none is dropped: the first two become blank, as those outside the frame.

    For each tile of the canvas a memory keeps the smallest weight, and whether the tile was ever painted. It is cleared
    after a reset and by ``i_clear``, a tile per clock; tiles wait until then.

    A tile takes 18 clocks, the last of them that in which the plan is taken.

    Parameters
    ----------
    place_bits : int
        The canvas has up to 2^n columns and rows of tiles, n from 1 to 7.
    """

    i: stream.Interface
    """Stream of `hdl.painting.corners.PROJECTED`. Taken together with its plan: corners are not stored. A tile may come
    again when it has been painted."""
    i_painted: data.View
    """`PAINTED_TILE`; not while the memory is cleared."""
    i_width_px: Signal
    """Size of the frame; constant while it is painted."""
    i_height_px: Signal
    i_replace: Signal
    """Nothing on the canvas stays; constant while a frame is painted."""
    i_clear: Signal
    """Forget what was painted; while no tile is inside."""
    o: stream.Interface
    """Stream of `PLAN`."""
    o_behind: Signal
    """A tile is dropped, or with ``i_replace`` blank, because it is not wholly in front of the camera."""
    o_too_large: Signal
    """A tile is dropped, or with ``i_replace`` blank, because its window would be too large."""
    o_cannot_win: Signal
    """A tile is dropped because it would not change the canvas."""
    o_clearing: Signal
    """The memory is being cleared."""

    latency_cycles = JUDGE_STEP
    """From a tile to its plan."""

    def __init__(self, *, place_bits: int = PLACE_BITS) -> None:
        check_range("place_bits", place_bits, 1, PLACE_BITS)
        self.place_bits = place_bits
        super().__init__(
            {
                "i": In(stream.Signature(PROJECTED)),
                "i_painted": In(PAINTED_TILE),
                "i_width_px": In(SIDE),
                "i_height_px": In(SIDE),
                "i_replace": In(1),
                "i_clear": In(1),
                "o": Out(stream.Signature(PLAN)),
                "o_behind": Out(1),
                "o_too_large": Out(1),
                "o_cannot_win": Out(1),
                "o_clearing": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Look at a corner per clock, then judge the box around them."""
        m = Module()
        step = Signal(range(JUDGE_STEP + 1))
        tile, plan = self.i.payload, self.o.payload
        kept = self._keep(m)
        distances, sizes = [], []
        for axis, size, names in (
            ("x", self.i_width_px, ("left", "right")),
            ("y", self.i_height_px, ("top", "bottom")),
        ):
            least, most = self._measure(m, axis, step)
            last = delayed(m, size - 1, 1)
            distances += [delayed(m, most, 1), delayed(m, last - least, 1)]
            sizes.append(most - least)
            cut = delayed(m, Mux(least < 0, 0, least), 1), delayed(m, Mux(most > last, last, most), 1)
            m.d.comb += [plan[name].eq(side) for name, side in zip(names, cut, strict=True)]
        is_large = delayed(m, (sizes[0] >= WINDOW_PX) | (sizes[1] >= WINDOW_PX), 1)
        weight = weigh(m, distances, weight_shift(m, self.i_width_px, self.i_height_px))
        is_outside = delayed(m, weight == 0, 1)
        wins = delayed(m, (weight != 0) & (weight + (FADE >> 1) > kept.least), 1)
        judges = Signal()
        drops = ~self.i_replace & (tile.behind | is_large | ~wins)
        m.d.comb += [
            plan.tile.eq(tile.tile),
            plan.corners.eq(tile.corners),
            plan.painted.eq(kept.painted),
            plan.blank.eq(tile.behind | is_large | is_outside),
            judges.eq(self.i.valid & ~self.o_clearing & (step == JUDGE_STEP)),
            self.o.valid.eq(judges & ~drops),
            self.i.ready.eq(judges & (drops | self.o.ready)),
            self.o_behind.eq(self.i.ready & tile.behind),
            self.o_too_large.eq(self.i.ready & ~tile.behind & is_large),
            self.o_cannot_win.eq(self.i.ready & drops & ~tile.behind & ~is_large),
        ]
        with m.If(self.i.ready):
            m.d.sync += step.eq(0)
        with m.Elif(self.i.valid & ~self.o_clearing & ~judges):
            m.d.sync += step.eq(step + 1)
        return m

    def _keep(self, m: Module) -> data.View:
        """What the memory says of the tile at the input."""
        m.submodules.tiles = tiles = LineMemory(shape=_KEPT, depth=1 << 2 * self.place_bits)
        painted, cleared = self.i_painted, Signal(2 * self.place_bits)
        clears = Signal(init=1)
        word = data.View(_KEPT, tiles.i_word)
        m.d.comb += [
            self.o_clearing.eq(clears),
            tiles.i_read.eq(1),
            tiles.i_read_address.eq(self._address(self.i.payload.tile)),
            tiles.i_write.eq(painted.valid | clears),
            tiles.i_write_address.eq(Mux(clears, cleared, self._address(painted.tile))),
            word.painted.eq(~clears),
            word.least.eq(Mux(clears, 0, painted.least)),
        ]
        m.d.sync += [cleared.eq(cleared + clears), clears.eq(self.i_clear | (clears & ~cleared.all()))]
        return data.View(_KEPT, tiles.o_word)

    def _address(self, tile: data.View) -> Value:
        return Cat(tile.column[: self.place_bits], tile.row[: self.place_bits])

    def _measure(self, m: Module, axis: str, step: Signal) -> tuple[Signal, Signal]:
        """First and last pixel that a tile needs along an axis, `BOX_CYCLES` after its last corner."""
        corner = delayed(m, Array(each[axis] for each in self.i.payload.corners)[step], 1)
        nearest = delayed(m, (corner + HALF_POSITION) >> CORNER.fraction_bits, 1)
        least = Signal(WHOLE, name=f"least_{axis}", reset_less=True)
        most = Signal(WHOLE, name=f"most_{axis}", reset_less=True)
        is_first = delayed(m, step == 0, 2)
        # While a plan waits, its box stays.
        with m.If(delayed(m, step <= LAST_CORNER, 2)):
            m.d.sync += [
                least.eq(Mux(is_first | (nearest < least), nearest, least)),
                most.eq(Mux(is_first | (nearest >= most), nearest + 1, most)),
            ]
        return least, most
