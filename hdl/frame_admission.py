"""Frame admission: tags pixels with (x, y), flags frames of the wrong size, and refuses impossible settings."""

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream
from amaranth.lib.wiring import In, Out

from golden_model.config import MAX_FRAME_PX, MIN_FRAME_PX
from golden_model.records import FRAME_STATUS, Cause
from hdl.lib.component import Component
from hdl.lib.delay import delayed, port_register
from hdl.streams import COORDINATE, beat, pixel_payload

CAUSES = next(field.bits for field in FRAME_STATUS.fields if field.name == "causes")


class FrameAdmission(Component):
    """Admits pixels, numbers them, and checks ``first`` and ``last`` against the configured size.

    In video mode a frame starts with ``first``, and each line ends with ``last``. In memory mode nothing marks frames
    or lines: a frame starts where the previous one has ended, and ``last`` ends a transfer.

    Every frame that starts also ends. A bad frame goes on with whatever pixels come. If it ends early (at the next
    ``first``, or at the end of a transfer), zeros complete its line, and then only the ends of its last lines, which
    close the levels: the next frame waits for one line and ``closing_lines`` times ``closing_px`` clocks at most, with
    one more of either where the side is odd.

    Pixels outside of any frame are dropped, and reported as a bad frame without beats (`Cause.MISSING_START`). After a
    good frame the first such pixel is reported. A bad frame may leave pixels behind, so after one they are reported
    only when they fill a frame's lines. A frame whose settings are not acceptable has no beats either
    (`Cause.INVALID_SETTINGS`): its first pixel reports it, and pixels are dropped up to the next start or, in memory
    mode, the end of the transfer.

    Throughput is one beat per clock, unless an input below forbids it. Frames and lines start with the left pixel of a
    beat.

    Parameters
    ----------
    closing_lines : int
        Number of last lines that the levels need in order to close.
    closing_px : int
        How much of each of these lines they need.
    """

    i: stream.Interface
    """Stream of `hdl.streams.pixel_payload`."""
    i_memory_mode: In(1)
    """Memory mode; 0: video mode."""
    i_width_px: In(range(MAX_FRAME_PX + 1))
    """Width of the frame, at least 4 beats."""
    i_height_px: In(range(MAX_FRAME_PX + 1))
    """Height of the frame."""
    i_acceptable: In(1)
    """The settings are within what was built. Like size and mode, stable 2 clocks before ``i_may_start``."""
    i_may_start: In(1)
    """A frame may start; pixels outside of a frame may be dropped."""
    i_may_end: In(1)
    """A frame may end from the next clock on. Ignored in the clock of ``o_end`` and the one before."""
    i_hold: In(1)
    """Admit nothing."""
    o: data.View
    """Beats of ``data``, one clock after the pixel."""
    o_running: Out(1)
    """A frame has started and has not ended."""
    o_frame_ends: Out(1)
    """The next beat will be the last of its frame."""
    o_start: Out(1)
    """With the first beat of a frame."""
    o_end: Out(1)
    """With the last beat of a frame, or where one without beats is reported."""
    o_causes: Out(CAUSES)
    """With ``o_end``: the first fault of the frame (`Cause`), or 0."""

    def __init__(self, *, closing_lines: int, closing_px: int = MIN_FRAME_PX, pixels_per_clock: int = 1) -> None:
        self.closing_lines = closing_lines
        self.closing_px = closing_px
        self.pixels_per_clock = pixels_per_clock
        super().__init__(
            i=In(stream.Signature(pixel_payload(pixels_per_clock))), o=Out(beat(pixels_per_clock, data=24))
        )

    def elaborate(self, platform: object) -> Module:
        """Decide whether a beat is admitted, count it, and check its flags."""
        m = Module()
        pixel, memory = self.i.payload, self.i_memory_mode
        padding = Signal()
        may_end = Signal()
        resynchronising = Signal()
        refusing = Signal()
        owes_status = Signal()
        starts = Signal()
        emits = Signal()
        ends = Signal()
        dropped_line = Signal()
        line_ends, is_last_line = self._count(m, starts, emits, padding, dropped_line)
        frame_ends = line_ends & is_last_line
        # In memory mode any pixel starts a frame, unless the rest of a refused transfer is being dropped.
        first = Mux(memory, ~refusing, pixel.first)
        waits = self.i.valid & ~self.o_running & self.i_may_start
        refused, stray = waits & first & ~self.i_acceptable, waits & ~first
        # After a bad frame, only a whole frame's lines are certain to be more than what it left over.
        is_missed = ~resynchronising | (owes_status & pixel.last & is_last_line & self.i_acceptable)
        missed = stray & ~memory & is_missed
        reported, dropped = (refused | missed) & may_end, stray & ~missed
        allowed = ~self.i_hold & (may_end | ~frame_ends)
        proceeds = self.i.valid & (memory | ~pixel.first) & self.o_running & ~padding & allowed
        # Registered, because admission depends on it; hence the two clocks in which the input is out of date.
        m.d.sync += may_end.eq(self.i_may_end & ~self.o_end & ~ends)
        m.d.comb += [
            starts.eq(waits & first & self.i_acceptable & allowed),
            emits.eq(starts | proceeds | (padding & allowed)),
            ends.eq((emits & frame_ends) | reported),
            dropped_line.eq(~memory & (dropped | (missed & reported)) & pixel.last),
            self.i.ready.eq(starts | proceeds | reported | dropped),
            self.o_frame_ends.eq(frame_ends),
        ]
        color = port_register(m, self.o.data)
        m.d.sync += [
            self.o.valid.eq(emits),
            Value.cast(color).eq(Mux(padding, 0, Value.cast(pixel.data))),
            self.o_start.eq(starts),
            self.o_end.eq(ends),
        ]

        # In video mode the next frame's first pixel stays at the input until zeros have completed this frame.
        cut_off = Mux(memory, (starts | proceeds) & pixel.last, self.i.valid & pixel.first & self.o_running)
        with m.If(cut_off):
            m.d.sync += padding.eq(1)
        with m.If(~memory):
            m.d.sync += refusing.eq(0)
        with m.Elif(self.i.ready & (refused | dropped)):
            m.d.sync += refusing.eq(~pixel.last)
        # A whole frame without a start has been dropped: further lines belong to another, which is to be reported.
        with m.If(dropped_line & is_last_line):
            m.d.sync += owes_status.eq(1)
        with m.If(reported):
            cause = Mux(refused, Cause.INVALID_SETTINGS, Cause.MISSING_START)
            m.d.sync += [self.o_causes.eq(cause), resynchronising.eq(1)]
            with m.If(~resynchronising | refused):
                m.d.sync += owes_status.eq(0)
        with m.If(emits):
            causes = Mux(starts | ~self.o_causes.any(), self._fault(m, padding, line_ends), self.o_causes)
            m.d.sync += [self.o_causes.eq(causes), self.o_running.eq(1)]
            with m.If(frame_ends):
                m.d.sync += [
                    self.o_running.eq(0),
                    padding.eq(0),
                    resynchronising.eq(causes.any()),
                    owes_status.eq(causes.any()),
                ]
        return m

    def _fault(self, m: Module, padding: Value, line_ends: Value) -> Value:
        """Return the fault of the beat that is admitted in this clock, or 0."""
        cause = Signal(CAUSES)
        last = self.i.payload.last
        with m.If(padding):
            m.d.comb += cause.eq(Cause.EARLY_END)
        with m.Elif(~self.i_memory_mode & last & ~line_ends):
            m.d.comb += cause.eq(Cause.SHORT_LINE)
        with m.Elif(~self.i_memory_mode & ~last & line_ends):
            m.d.comb += cause.eq(Cause.LONG_LINE)
        return cause

    def _count(
        self, m: Module, starts: Value, emits: Value, padding: Value, dropped_line: Value
    ) -> tuple[Value, Value]:
        """Number the beats. Returns whether the next beat ends its line, and whether that is the frame's last line.

        Both are registered one clock early, because admission depends on them. Between frames ``y`` counts the lines
        that are dropped.
        """
        x = Signal(COORDINATE)
        y = Signal(COORDINATE)
        last_but_one_x = Signal(COORDINATE, reset_less=True)
        last_y = Signal(COORDINATE, reset_less=True)
        closing_x = Signal(COORDINATE, reset_less=True)
        closing_y = Signal(COORDINATE, reset_less=True)
        line_ends = Signal()
        is_last_line = Signal()
        skips = Signal()
        beat_x = port_register(m, self.o.x)
        last_but_one: Value = self.i_width_px - 2
        if self.pixels_per_clock == 2:
            last_but_one = _even(self.i_width_px + 1, 4)
        m.d.sync += [
            last_but_one_x.eq(last_but_one),
            last_y.eq(self.i_height_px - 1),
            closing_x.eq(_even(self.i_width_px, self.closing_px)),
            closing_y.eq(_even(self.i_height_px, self.closing_lines)),
        ]
        with m.If(emits):
            following = Mux(padding & ~is_last_line, closing_x, 0)
            m.d.sync += [x.eq(Mux(line_ends, following, x + self.pixels_per_clock)), line_ends.eq(x == last_but_one_x)]
        # The line counter runs a clock behind admission: y is the line of the beat at the output.
        with m.If(delayed(m, emits & line_ends, 1, reset_less=False) | dropped_line):
            m.d.sync += y.eq(Mux(is_last_line, 0, Mux(skips, closing_y, y + 1)))
        with m.If(starts):
            m.d.sync += y.eq(0)
        m.d.sync += [beat_x.eq(x), is_last_line.eq(y == last_y), skips.eq(padding & (y < closing_y))]
        m.d.comb += self.o.y.eq(y)
        return line_ends, is_last_line


def _even(size_px: Value, distance_px: int) -> Value:
    """Coordinate ``distance_px`` before the end of a side, or just before it: even, since level 1 halves it."""
    coordinate = Mux(size_px > distance_px, size_px - distance_px, 0)
    return Cat(0, coordinate[1:])
