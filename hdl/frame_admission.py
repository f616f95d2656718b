"""Frame admission: tags pixels with (x, y) and flags frames of the wrong size."""

from __future__ import annotations

from amaranth import Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MAX_FRAME_PX
from golden_model.records import FRAME_STATUS, Cause
from hdl.lib.delay import delayed
from hdl.streams import COORDINATE, PixelPayload, beat

CAUSES = next(field.bits for field in FRAME_STATUS.fields if field.name == "causes")


class FrameAdmission(wiring.Component):
    """Admits pixels, numbers them, and checks ``first`` and ``last`` against the configured size.

    Later blocks always see whole frames. A bad frame continues with whatever pixels come; if the next frame starts
    before it is complete, that start waits until the bad frame has been padded with zeros. After a bad frame, pixels
    are dropped until the next start. Pixels outside of any frame are reported as a bad frame without beats.

    Throughput is a pixel a clock, unless an input below forbids it.

    Members
    -------
    i : In(stream(PixelPayload))
    i_width_px, i_height_px : In
        At least 4. Must be stable 2 clocks before a frame is admitted.
    i_may_start : In(1)
        A frame may start.
    i_may_end : In(1)
        A frame may end from the next clock on. Ignored in the clock of ``o_end`` and the one before.
    i_hold : In(1)
        Admit nothing.
    o : Out(beat(data))
        One clock after the pixel.
    o_running : Out(1)
        A frame has started and has not ended.
    o_start, o_end : Out(1)
        With the first beat of a frame, and with its last.
    o_causes : Out(16)
        With ``o_end``: the first fault of the frame (`Cause`), or 0.
    """

    i: stream.Interface
    i_width_px: Signal
    i_height_px: Signal
    i_may_start: Signal
    i_may_end: Signal
    i_hold: Signal
    o: data.View
    o_running: Signal
    o_start: Signal
    o_end: Signal
    o_causes: Signal

    def __init__(self) -> None:
        super().__init__(
            {
                "i": In(stream.Signature(PixelPayload)),
                "i_width_px": In(range(MAX_FRAME_PX + 1)),
                "i_height_px": In(range(MAX_FRAME_PX + 1)),
                "i_may_start": In(1),
                "i_may_end": In(1),
                "i_hold": In(1),
                "o": Out(beat(data=24)),
                "o_running": Out(1),
                "o_start": Out(1),
                "o_end": Out(1),
                "o_causes": Out(CAUSES),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Decide whether a beat is admitted, count it, and check its flags."""
        m = Module()
        pixel = self.i.payload
        emits, ends, resynchronising, padding, may_end = (Signal() for _ in range(5))
        line_ends, frame_ends = self._count(m, emits)
        m.d.sync += may_end.eq(self.i_may_end & ~self.o_end & ~ends)
        allowed = ~self.i_hold & (may_end | ~frame_ends)
        starts = self.i.valid & pixel.first & ~self.o_running & self.i_may_start & allowed
        proceeds = self.i.valid & ~pixel.first & self.o_running & ~padding & allowed
        stray = self.i.valid & ~pixel.first & ~self.o_running
        reported = stray & ~resynchronising & may_end
        m.d.comb += [
            emits.eq(starts | proceeds | (padding & allowed)),
            ends.eq((emits & frame_ends) | reported),
            self.i.ready.eq(starts | proceeds | reported | (stray & resynchronising)),
        ]

        cause = Signal(CAUSES)
        with m.If(padding):
            m.d.comb += cause.eq(Cause.EARLY_END)
        with m.Elif(pixel.last & ~line_ends):
            m.d.comb += cause.eq(Cause.SHORT_LINE)
        with m.Elif(~pixel.last & line_ends):
            m.d.comb += cause.eq(Cause.LONG_LINE)

        m.d.sync += [
            self.o.valid.eq(emits),
            self.o.data.eq(Mux(padding, 0, pixel.data)),
            self.o_start.eq(starts),
            self.o_end.eq(ends),
        ]
        # The next frame's first pixel stays at the input until zeros have completed this frame.
        with m.If(self.i.valid & pixel.first & self.o_running):
            m.d.sync += padding.eq(1)
        with m.If(reported):
            m.d.sync += [self.o_causes.eq(Cause.MISSING_START), resynchronising.eq(1)]
        with m.If(emits):
            causes = Mux(starts | ~self.o_causes.any(), cause, self.o_causes)
            m.d.sync += [
                self.o_causes.eq(causes),
                self.o_running.eq(1),
            ]
            with m.If(frame_ends):
                m.d.sync += [self.o_running.eq(0), padding.eq(0), resynchronising.eq(causes.any())]
        return m

    def _count(self, m: Module, emits: Value) -> tuple[Value, Value]:
        """Number the beats. Returns whether the next beat ends its line, and whether it ends its frame.

        Both are registered one clock early, because admission depends on them.
        """
        x, y, last_but_one_x, last_y = (Signal(COORDINATE) for _ in range(4))
        line_ends, is_last_line = Signal(), Signal()
        m.d.sync += [last_but_one_x.eq(self.i_width_px - 2), last_y.eq(self.i_height_px - 1)]
        with m.If(emits):
            m.d.sync += [x.eq(Mux(line_ends, 0, x + 1)), line_ends.eq(x == last_but_one_x)]
        # The line counter runs a clock behind admission: y is the line of the beat at the output.
        with m.If(delayed(m, emits & line_ends, 1, reset_less=False)):
            m.d.sync += y.eq(Mux(is_last_line, 0, y + 1))
        m.d.sync += [self.o.x.eq(x), is_last_line.eq(y == last_y)]
        m.d.comb += self.o.y.eq(y)
        return line_ends, line_ends & is_last_line
