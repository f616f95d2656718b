"""The painter in its shell: behind registers, and fed by the camera's gate and the estimator."""

from amaranth import Cat, Module, Mux, ResetInserter, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MAX_FRAME_PX
from golden_model.painting.tiles import MAX_TILES, TILE_PX
from hdl.axi.axi_read import AXI_READ
from hdl.axi.axi_write import AXI_WRITE
from hdl.axi.video_input import VideoPayload
from hdl.lib.delay import delayed
from hdl.painting.canvas_port import HOLDS
from hdl.painting.frame_writer import BURST_PX, PIXEL_BYTES
from hdl.painting.line_reader import SHOWN, LineReader, add_reader
from hdl.painting.painter import Painter
from hdl.painting.pose import ELEMENTS
from hdl.registers.register_file import RegisterFile
from hdl.settings import PAGE_BYTES, POSE_ELEMENTS
from hdl.shell.placements import Placements
from hdl.shell.ring_writer import count_up
from hdl.streams import WordPayload

PAINTER_PORTS = {"frames": AXI_WRITE, "windows": AXI_READ, "old_tiles": AXI_READ, "new_tiles": AXI_WRITE}
PORTS = PAINTER_PORTS | {"pictures": AXI_READ}
"""Ports to memory."""
PAGE_BITS = (PAGE_BYTES - 1).bit_length()
PAGE_PX = PAGE_BYTES // PIXEL_BYTES
MIN_SIDE_PX = 2


class Painting(wiring.Component):
    """`Painter` with its settings, counters and poses in registers, placements of records, and pictures for a display.

    It never makes the camera wait, nor the records. Its settings are taken while it is off and nothing is under way,
    and so is the request to forget the canvas; with faults (`PainterFault`) it stays off.

    Parameters
    ----------
    registers : RegisterFile
        The registers of a build with a painter; the fields of `PAINTER_REGISTERS` are driven here.
    """

    i_valid: In(1)
    """The accelerator takes ``i`` in this clock."""
    i: In(VideoPayload)
    """Colour, or gray where the register ``gray_input`` says so; it has all three channels on the canvas."""
    i_homographies: In(stream.Signature(WordPayload))
    """A packet for every frame, in which frames count from 0 since a reset; ready is always 1."""
    i_stop: In(1)
    """Give up all but what is being painted, so that ``o_idle`` comes, and a reset may."""
    i_forget: In(1)
    """A reset, while ``o_idle``, of all but the picture that is still being shown."""
    frames: Out(AXI_WRITE)
    windows: Out(AXI_READ)
    old_tiles: Out(AXI_READ)
    new_tiles: Out(AXI_WRITE)
    pictures: Out(AXI_READ)
    o_picture: Out(stream.Signature(SHOWN))
    """For a display, from what is shown."""
    o_idle: Out(1)
    """Nothing is open on any port, and nothing begins while ``i_stop``."""

    def __init__(self, *, registers: RegisterFile) -> None:
        self._registers = registers
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Connect the painter; switch it on and off."""
        whole, m = Module(), Module()
        whole.submodules.painting = ResetInserter(self.i_forget)(m)
        registers, reader = self._registers, add_reader(whole, self.pictures, self.o_picture)
        m.submodules.painter = painter = Painter()
        m.submodules.placements = placements = ResetInserter(painter.i_clear)(Placements())
        is_on, shows, faults, is_gray = Signal(), Signal(), self._faults(m), registers.o_gray_input
        is_off = ~is_on & painter.o_idle & reader.o_idle
        wanted = registers.o_painter_enable & ~registers.o_painter_clear & ~self.i_stop
        m.d.sync += is_on.eq(wanted & (is_on | (is_off & ~faults.any())))
        with m.If(is_off):
            m.d.sync += [port.eq(setting) for port, setting in self._settings(painter, shows, reader)]
        data = self.i.data
        # A register, since the accelerator's ready is late.
        m.d.sync += [
            painter.i.valid.eq(self.i_valid),
            painter.i.data.eq(Mux(is_gray, data[:8].replicate(3), data)),
            painter.i.first.eq(self.i.first),
            painter.i.last.eq(self.i.last),
        ]
        m.d.comb += [
            painter.i_enable.eq(is_on),
            painter.i_clear.eq(registers.o_painter_clear & is_off),
            registers.i_painter_clear.eq(painter.i_clear),
            registers.i_painter_refused.eq(Mux(registers.o_painter_enable & ~is_on, faults, 0)),
            registers.i_painter_idle.eq(painter.o_idle),
            reader.i.valid.eq(shows & is_on),
            # Off after a clear until all is on again: nothing is open then, as a reset needs it.
            reader.i_stop.eq(~is_on | ~registers.o_enable),
            reader.i_page.eq(painter.o_page),
            reader.i_held.eq(painter.o_held[1]),
            painter.i_holds[1].eq(reader.o_hold),
            self.o_idle.eq(is_off),
        ]
        for port in PAINTER_PORTS:
            wiring.connect(m, getattr(painter, port), wiring.flipped(getattr(self, port)))
        self._place(m, painter, placements, is_on)
        is_read_again = self._hold(m, painter)
        self._count(m, painter, placements, pages_repeated=is_read_again, pictures_failed=reader.o_failed)
        with m.If(reader.i.valid & reader.i.ready):
            m.d.sync += registers.i_pictures_begun.eq(registers.i_pictures_begun + 1)
        return whole

    def _settings(self, painter: Painter, shows: Signal, reader: LineReader) -> list[tuple[Signal, Value]]:
        """What is set, each with the bits of registers that are its setting."""
        registers = self._registers
        pages = {
            area: Cat(getattr(registers, f"o_{area}_base_low"), getattr(registers, f"o_{area}_base_high"))[PAGE_BITS:]
            for area in ("canvas", "frames")
        }
        return [
            (painter.i_replace, registers.o_painter_replace),
            (painter.i_max_links, registers.o_painter_max_links),
            (painter.i_width_px, registers.o_width_px),
            (painter.i_height_px, registers.o_height_px),
            (painter.i_columns, registers.o_canvas_columns),
            (painter.i_rows, registers.o_canvas_rows),
            (painter.i_canvas_page, pages["canvas"]),
            (painter.i_frames_page, pages["frames"]),
            (painter.i_buffer_pages, registers.o_frames_buffer_pages),
            (shows, registers.o_picture_enable),
            (reader.i.payload.columns, registers.o_canvas_columns),
            (reader.i.payload.lines, registers.o_picture_lines),
            (reader.i.payload.border, registers.o_picture_border),
        ]

    def _faults(self, m: Module) -> Signal:
        """`PainterFault` of what the registers say, two clocks later: no two writes follow each other faster."""
        registers = self._registers
        width, height = registers.o_width_px, registers.o_height_px
        row_bursts = width + BURST_PX - 1 >> BURST_PX.bit_length() - 1
        needed_px = Signal(len(width) + len(height) + 1)
        faults = Signal(registers.i_painter_refused.shape())
        lines, rows = registers.o_picture_lines, registers.o_canvas_rows
        canvas_sides, frame_sides = (registers.o_canvas_columns, rows), (width, height)
        m.d.sync += [
            needed_px.eq((height * row_bursts) << BURST_PX.bit_length() - 1),
            faults.eq(
                Cat(
                    registers.o_canvas_base_low[:PAGE_BITS].any(),
                    Cat((side == 0) | (side > MAX_TILES) for side in canvas_sides).any(),
                    registers.o_frames_base_low[:PAGE_BITS].any(),
                    (registers.o_frames_buffer_pages << PAGE_PX.bit_length() - 1) < needed_px,
                    Cat((side < MIN_SIDE_PX) | (side > MAX_FRAME_PX) for side in frame_sides).any(),
                    registers.o_picture_enable & ((lines == 0) | (lines > rows * TILE_PX)),
                )
            ),
        ]
        return faults

    def _place(self, m: Module, painter: Painter, placements: Placements, is_on: Value) -> None:
        """Send placements to the painter, and tell the host what became of its own."""
        registers = self._registers
        wiring.connect(m, wiring.flipped(self.i_homographies), placements.i)
        wiring.connect(m, placements.o, painter.i_poses)
        m.d.comb += [
            placements.i_enable.eq(is_on),
            painter.i_nowhere.eq(placements.o_nowhere),
            placements.i_set.eq(registers.o_pose_set),
            placements.i_pose.frame.eq(registers.o_pose_frame),
            *(placements.i_pose.elements[n].eq(getattr(registers, f"o_{POSE_ELEMENTS[n]}")) for n in range(ELEMENTS)),
            registers.i_pose_waiting.eq(placements.o_waiting),
        ]
        offer, newest = placements.o, Signal.like(registers.i_pose_newest)
        with m.If(painter.o_refused):
            m.d.sync += registers.i_pose_causes.eq(painter.o_causes)
        with m.If(offer.valid & offer.ready):
            with m.If(offer.payload.composed):
                # The accelerator counts from 0, the painter from 1.
                m.d.sync += newest.eq(offer.payload.frame - 1)
            with m.Else():
                m.d.sync += registers.i_pose_answer.eq(Mux(painter.o_refused, painter.o_causes, 0))
                m.d.sync += registers.i_pose_newest.eq(newest)

    def _hold(self, m: Module, painter: Painter) -> Value:
        """Hand on what is being read; whether this begins with a page that was read before."""
        registers, was_read = self._registers, Signal()
        held = Cat(painter.i_holds[n].valid for n in range(HOLDS.length))
        begins = (held & ~delayed(m, held, 1, reset_less=False)).any()
        m.d.comb += [
            painter.i_holds[0].valid.eq(registers.o_painter_hold & ~self.i_stop),
            painter.i_holds[0].row.eq(registers.o_painter_hold_row),
            registers.i_painter_held.eq(painter.o_held[0]),
            registers.i_painter_page.eq(painter.o_shown),
        ]
        m.d.sync += was_read.eq(~painter.o_flips & (was_read | begins))
        is_read_again: Value = begins & was_read & painter.i_replace
        return is_read_again

    def _count(self, m: Module, painter: Painter, placements: Placements, **others: Value) -> None:
        """Count what happens, and take each report at once."""
        registers, report = self._registers, painter.o.payload
        events = {
            "frames_cut": painter.o_cut,
            "frames_lost": painter.o_lost,
            "frames_skipped": painter.o_skipped,
            "frames_unplaced": painter.o_unplaced,
            "pose_refused": painter.o_refused,
            "pose_unmatched": painter.o_unmatched,
            "pose_lost": placements.o_lost,
            "pose_ignored": placements.o_ignored,
            **others,
        }
        for name, happens in events.items():
            count = getattr(registers, f"i_{name}")
            with m.If(happens):
                m.d.sync += count.eq(count_up(count))
        m.d.comb += painter.o.ready.eq(1)
        with m.If(painter.o_lost | (painter.o.valid & report.counts.has_errors)):
            m.d.sync += registers.i_painter_errors.eq(1)
        with m.If(painter.o.valid):
            m.d.sync += registers.i_frames_painted.eq(registers.i_frames_painted + 1)
            m.d.sync += registers.i_frames_last.eq(report.frame - 1)
            for name in ("behind", "too_large", "failed"):
                count = getattr(registers, f"i_tiles_{name}")
                m.d.sync += count.eq(count + report.counts[name])
