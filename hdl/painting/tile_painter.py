"""Paints a frame in memory onto a canvas in memory, tile by tile."""

from amaranth import Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.tiles import MAX_TILES
from hdl.axi.axi_read import AXI_READ
from hdl.axi.axi_write import AXI_WRITE
from hdl.lib.delay import delayed
from hdl.painting.blending import Blending
from hdl.painting.canvas_port import HOLDS, CanvasPort
from hdl.painting.corners import CornerProjector
from hdl.painting.pose import COLUMN
from hdl.painting.positions import Positions
from hdl.painting.sampling import Sampling
from hdl.painting.tiles import FRAME_SIDE, TileWalker
from hdl.painting.window_reader import WindowReader
from hdl.painting.windows import WindowPlanner
from hdl.streams import fork, join

TILES = range(MAX_TILES * MAX_TILES + 1)
COUNTS = data.StructLayout(
    dict.fromkeys(("offered", "behind", "too_large", "cannot_win", "painted", "failed"), TILES) | {"has_errors": 1}
)
"""Tiles of a frame, as `golden_model.painting.painter.Counts` has them; and those that ``failed``, since their part of
the frame could not be read: they are painted without it. ``has_errors``: memory has answered with an error."""


class TilePainter(wiring.Component):
    """All that happens between a pose and the canvas; equal to `golden_model.painting.painter.Painter.paint`.

    What stands at ``i_`` stays while a frame is painted. Tiles, corners, plans, windows, pixels and words are streams,
    so a memory that is slow makes everything wait, and nothing else.
    """

    i: In(stream.Signature(COLUMN))
    """A pose, three columns."""
    i_begin: In(1)
    """Begin to count; before the first column."""
    i_page: In(52)
    """Where the frame begins, in pages of 4 KiB (`hdl.painting.frame_writer.FrameWriter`)."""
    i_width_px: In(FRAME_SIDE)
    i_height_px: In(FRAME_SIDE)
    i_replace: In(1)
    """Forget the canvas."""
    i_canvas_page: In(52)
    """Where the canvas begins."""
    i_columns: In(range(MAX_TILES + 1))
    """Size of the canvas, in tiles."""
    i_rows: In(range(MAX_TILES + 1))
    i_holds: In(HOLDS)
    """`CanvasPort.i_holds`, as ``o_held``."""
    i_clear: In(1)
    """Forget what was painted, while ``o_idle``."""
    windows: Out(AXI_READ)
    old_tiles: Out(AXI_READ)
    new_tiles: Out(AXI_WRITE)
    o_counts: Out(COUNTS)
    """The last frame's, while ``o_idle``."""
    o_held: Out(HOLDS.length)
    o_clearing: Out(1)
    """Tiles wait until the canvas is forgotten."""
    o_idle: Out(1)
    """The pose's last tile is in memory. Low from the first column on."""

    def elaborate(self, platform: object) -> Module:
        """Join the blocks, and count the tiles between the first of them and the last."""
        m = Module()
        m.submodules.tiles = tiles = TileWalker()
        m.submodules.corners = corners = CornerProjector()
        m.submodules.planner = planner = WindowPlanner()
        m.submodules.reader = reader = WindowReader()
        m.submodules.positions = positions = Positions()
        m.submodules.sampling = sampling = Sampling()
        m.submodules.blending = blending = Blending()
        m.submodules.canvas = canvas = CanvasPort()
        for block in (tiles, planner, reader, sampling):
            for name in ("i_width_px", "i_height_px", "i_columns", "i_rows", "i_replace"):
                if name in block.signature.members:
                    m.d.comb += getattr(block, name).eq(getattr(self, name))
        m.d.comb += [
            canvas.i_replace.eq(self.i_replace),
            canvas.i_columns.eq(self.i_columns),
            canvas.i_page.eq(self.i_canvas_page),
            canvas.i_holds.eq(self.i_holds),
            self.o_held.eq(canvas.o_held),
            reader.i_page.eq(self.i_page),
            planner.i_clear.eq(self.i_clear),
            planner.i_painted.eq(canvas.o_painted),
            self.o_clearing.eq(planner.o_clearing),
        ]
        wiring.connect(m, reader.bus, wiring.flipped(self.windows))
        wiring.connect(m, canvas.reads, wiring.flipped(self.old_tiles))
        wiring.connect(m, canvas.writes, wiring.flipped(self.new_tiles))
        fork(m, self.i, tiles.i, corners.i_pose)
        wiring.connect(m, tiles.o, corners.i)
        wiring.connect(m, corners.o, planner.i)
        fork(m, planner.o, reader.i, canvas.i)
        wiring.connect(m, reader.o, positions.i)
        wiring.connect(m, positions.o, sampling.i)
        # A register between the bus and the block RAMs: the last word is there two clocks before its tile is read.
        m.d.comb += sampling.i_write.eq(delayed(m, reader.o_write, 1, reset_less=False))
        join(m, blending.i, old=canvas.o, new=sampling.o)
        wiring.connect(m, blending.o, canvas.i_new)
        self._count(m, tiles, planner, reader, canvas)
        return m

    def _count(
        self, m: Module, tiles: TileWalker, planner: WindowPlanner, reader: WindowReader, canvas: CanvasPort
    ) -> None:
        counts, under_way = self.o_counts, Signal(TILES)
        events = {
            "offered": tiles.o.valid & tiles.o.ready,
            "behind": planner.o_behind,
            "too_large": planner.o_too_large,
            "cannot_win": planner.o_cannot_win,
            "painted": canvas.o_painted.valid,
            "failed": reader.o_failed,
        }
        for name, happens in events.items():
            m.d.sync += counts[name].eq(Mux(self.i_begin, 0, counts[name] + delayed(m, happens, 1)))
        m.d.sync += counts.has_errors.eq(~self.i_begin & (counts.has_errors | reader.o_error | canvas.o_error))
        # A tile is dropped for one reason only; with `i_replace` it is painted nevertheless.
        dropped = planner.o_behind | planner.o_too_large | planner.o_cannot_win
        m.d.sync += under_way.eq(under_way + events["offered"] - (dropped & ~self.i_replace) - canvas.o_painted.valid)
        m.d.comb += self.o_idle.eq(tiles.o_idle & (under_way == 0) & canvas.o_idle)
