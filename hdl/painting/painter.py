"""The painter: a camera's frames and their poses in, a canvas in memory."""

from amaranth import Cat, Module, Mux, ResetInserter, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.pose import MAX_LINKS
from golden_model.painting.tiles import MAX_TILES
from hdl.axi.axi_read import AXI_READ
from hdl.axi.axi_write import AXI_WRITE
from hdl.lib.delay import delayed
from hdl.lib.multiplier import multiply
from hdl.lib.views import view_signal
from hdl.painting.canvas_port import HOLDS
from hdl.painting.frame_writer import FRAME_NUMBER, STORED, VIDEO, FrameWriter
from hdl.painting.pose import CAUSES, PLACEMENT, Poses
from hdl.painting.tile_painter import COUNTS, TilePainter
from hdl.painting.tiles import FRAME_SIDE

REPORT = data.StructLayout({"frame": FRAME_NUMBER, "counts": COUNTS})
"""A frame that has been painted: its number, and what became of its tiles."""
NOWHERE = data.StructLayout({"valid": 1, "frame": FRAME_NUMBER})
"""A frame of which no homography says where it is."""
POSE_COLUMNS = 3


class Painter(wiring.Component):
    """Paints each frame of a camera that has a pose; equal to `golden_model.painting.painter.Painter`.

    A frame and a pose meet by their number, counted from 1 at ``i``. Whichever is older is given up: a pose whose frame
    was lost, a frame whose pose never came. While a frame is painted, the next waits in memory and its pose is
    composed; further ones are skipped. A frame whose pose is refused waits for a host's until the next one is complete,
    which takes its place. The camera never waits.

    All settings but ``i_enable`` may change only while ``o_idle`` and not ``i_enable``. There are four ports to memory:
    the camera's frames go in, their windows come out, tiles of the canvas come out and go in. Switched off, the painter
    gives up frames and poses, but for the frame that is being painted: that is finished before the painter is idle;
    then nothing is open on any port, as a reset needs it. Poses can be composed with each other meanwhile. Software
    clears the canvas in memory: tiles that are not painted stay as they are.

    Stabilised video has two canvases: a frame is painted into the one while the other is shown. When it is whole, and
    nobody reads the other, they change their places; until then the next frame waits, and yields to newer ones. A
    canvas that memory has refused a part of is not shown. A mosaic is painted in place, and read row by row of tiles:
    a tile in a row that is being read waits, and all behind it.
    """

    i: In(VIDEO)
    """The camera."""
    i_poses: In(stream.Signature(PLACEMENT))
    """In the order of the frames."""
    i_nowhere: In(NOWHERE)
    """In their order, too."""
    i_enable: In(1)
    """Take frames."""
    i_replace: In(1)
    """For stabilised video: every frame makes a new canvas. Clear when you change it."""
    i_clear: In(1)
    """Forget the canvas and the poses, while ``o_idle``."""
    i_width_px: In(FRAME_SIDE)
    """Size of the frames."""
    i_height_px: In(FRAME_SIDE)
    i_frames_page: In(52)
    """Where three buffers for frames begin, in pages of 4 KiB."""
    i_buffer_pages: In(20)
    """From one buffer to the next (`hdl.painting.frame_writer.frame_pages`)."""
    i_canvas_page: In(52)
    """Where the canvas begins, a page for each tile; with ``i_replace`` a second one follows behind its last tile."""
    i_columns: In(range(MAX_TILES + 1))
    """Size of the canvas, in tiles."""
    i_rows: In(range(MAX_TILES + 1))
    i_max_links: In(range(MAX_LINKS + 1))
    """Homographies that may be composed after a host's pose."""
    i_holds: In(HOLDS)
    """What is being read: rows of the canvas, or with ``i_replace`` all of the one that is shown."""
    o_held: Out(HOLDS.length)
    """From the clock after a hold on, whether what is held stays as it is at ``o_page``, for as long as it is held."""
    o_page: Out(52)
    """Where the canvas begins that is shown."""
    o_shown: Out(1)
    """With ``i_replace``, whether that is the second one."""
    o_flips: Out(1)
    """The other one is shown from now on."""
    frames: Out(AXI_WRITE)
    windows: Out(AXI_READ)
    old_tiles: Out(AXI_READ)
    new_tiles: Out(AXI_WRITE)
    o: Out(stream.Signature(REPORT))
    """Every painted frame, when all of it is in memory. The next one is painted when this has been taken."""
    o_refused: Out(1)
    """A pose has been refused."""
    o_causes: Out(CAUSES)
    """With ``o_refused``, why."""
    o_unmatched: Out(1)
    """A pose has been given up: its frame is not in memory, or the painter is off."""
    o_unplaced: Out(1)
    """A frame has been given up: its pose has been refused, or has not come, or what is shown was held too long."""
    o_cut: Out(1)
    """A frame was not as large as set, or too fast for the memory."""
    o_lost: Out(1)
    """A frame has been given up: the memory answered with an error."""
    o_skipped: Out(1)
    """A frame has been given up: another waits to be painted."""
    o_idle: Out(1)
    """Nothing is under way."""

    def elaborate(self, platform: object) -> Module:
        """Frames are stored and poses composed until both meet; then the frame's tiles are painted."""
        m = Module()
        m.submodules.writer = writer = FrameWriter()
        poses, painter = Poses(), TilePainter()
        m.submodules.poses = ResetInserter(self.i_clear)(poses)
        m.submodules.tiles = painter
        for inner, outer in (
            (writer.bus, self.frames),
            (painter.windows, self.windows),
            (painter.old_tiles, self.old_tiles),
            (painter.new_tiles, self.new_tiles),
        ):
            wiring.connect(m, inner, wiring.flipped(outer))
        wiring.connect(m, wiring.flipped(self.i_poses), poses.i)
        driven = {
            writer: {"i", "i_page", "i_yields"},
            poses: {"i"},
            painter: {"i", "i_begin", "i_page", "i_canvas_page", "i_holds"},
        }
        for block, names in driven.items():
            # All others are settings, of the same names here.
            settings = {name for name, member in block.signature.members.items() if member.flow == In} - names
            m.d.comb += [getattr(block, name).eq(getattr(self, name)) for name in sorted(settings)]
        m.d.comb += [
            writer.i.eq(self.i),
            writer.i_page.eq(self.i_frames_page),
            self.o_refused.eq(poses.o_refused),
            self.o_causes.eq(poses.o_causes),
            self.o_cut.eq(writer.o_cut),
            self.o_lost.eq(writer.o_failed),
            self.o_skipped.eq(writer.o_skipped),
        ]
        is_whole = self._show(m, painter)
        self._yield(m, writer, poses, is_whole)
        self._meet(m, writer, poses, painter, is_whole)
        return m

    def _show(self, m: Module, painter: TilePainter) -> Signal:
        """Choose what is painted and what is shown; whether a canvas is whole that waits to be shown."""
        is_whole, is_second, replaces = Signal(), Signal(), self.i_replace.replicate(HOLDS.length)
        held = Cat(self.i_holds[n].valid for n in range(HOLDS.length))
        was_held = delayed(m, held, 1, reset_less=False)
        tiles = Mux(self.i_replace, multiply(m, "page_tiles", self.i_columns, self.i_rows), 0)
        shown, painted = (self.i_canvas_page + Mux(behind, tiles, 0) for behind in (is_second, ~is_second))
        m.d.sync += [self.o_page.eq(shown), painter.i_canvas_page.eq(painted), is_second.eq(is_second ^ self.o_flips)]
        m.d.comb += [
            painter.i_holds.eq(Mux(self.i_replace, 0, self.i_holds)),
            self.o_held.eq(was_held & (painter.o_held | replaces)),
            self.o_shown.eq(is_second & self.i_replace),
            self.o_flips.eq(is_whole & ~held.any()),
        ]
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += is_whole.eq(self.i_replace & ~self.o.payload.counts.has_errors)
        with m.Elif(self.o_flips | self.i_clear):
            m.d.sync += is_whole.eq(0)
        return is_whole

    def _yield(self, m: Module, writer: FrameWriter, poses: Poses, is_whole: Value) -> None:
        """Let a frame whose pose was refused wait for a host's no longer than the next one comes.

        So does a frame that waits until what is shown may change.
        """
        nowhere, sent = view_signal(NOWHERE, name="nowhere"), self.i_poses.payload
        is_its_frame = writer.o.payload.number == nowhere.frame
        m.d.comb += writer.i_yields.eq((nowhere.valid & is_its_frame) | is_whole)
        with m.If(self.i_nowhere.valid):
            m.d.sync += nowhere.eq(self.i_nowhere)
        # The homography of a frame for which a host's pose is refused may still come.
        with m.Elif(poses.o_refused & sent.composed):
            m.d.sync += [nowhere.valid.eq(1), nowhere.frame.eq(sent.frame)]
        with m.Elif(writer.o.valid & ~is_its_frame):
            m.d.sync += nowhere.valid.eq(0)

    def _meet(self, m: Module, writer: FrameWriter, poses: Poses, painter: TilePainter, is_whole: Value) -> None:
        """Hold the frame that waits against the pose that waits; paint those of one number."""
        frame, column = view_signal(STORED, name="frame"), Signal(range(POSE_COLUMNS))
        waiting, pose = writer.o.payload, poses.o
        # Numbers wrap: the half of them is before a number, the other half behind it.
        ahead = (self.i_poses.payload.frame - waiting.number)[:FRAME_NUMBER]
        swallows, forwards, is_older = Signal(), Signal(), Signal()
        passes = pose.valid & pose.ready
        m.d.comb += [
            pose.ready.eq(swallows | (forwards & painter.i.ready)),
            painter.i.valid.eq(forwards & pose.valid),
            painter.i.payload.eq(pose.payload),
            painter.i_page.eq(frame.page),
            self.o_unplaced.eq(writer.o_yielded | is_older),
            self.o.payload.frame.eq(frame.number),
            self.o.payload.counts.eq(painter.o_counts),
        ]
        ends_pose = passes & (column == POSE_COLUMNS - 1)
        with m.If(passes):
            m.d.sync += column.eq(Mux(ends_pose, 0, column + 1))
        with m.FSM():
            with m.State("MEET"):
                meets = pose.valid & (writer.o.valid | ~self.i_enable)
                m.d.comb += self.o_idle.eq(writer.o_idle & ~painter.o_clearing & ~meets)
                m.d.sync += frame.eq(waiting)
                with m.If(meets):
                    with m.If(ahead[-1] | ~self.i_enable):
                        m.d.comb += self.o_unmatched.eq(1)
                        m.next = "SWALLOW"
                    with m.Elif(~is_whole | ahead.any()):
                        m.d.comb += [writer.o.ready.eq(1), is_older.eq(ahead.any()), painter.i_begin.eq(1)]
                        with m.If(~ahead.any()):
                            m.next = "PAINT"
            with m.State("SWALLOW"):
                m.d.comb += swallows.eq(1)
                with m.If(ends_pose):
                    m.next = "MEET"
            with m.State("PAINT"):
                m.d.comb += forwards.eq(1)
                with m.If(ends_pose):
                    m.next = "TILES"
            with m.State("TILES"), m.If(painter.o_idle):
                m.next = "REPORT"
            with m.State("REPORT"):
                m.d.comb += self.o.valid.eq(1)
                with m.If(self.o.ready):
                    m.next = "MEET"
