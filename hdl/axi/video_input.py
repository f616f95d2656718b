"""Video ingress: AXI4-Stream video, or a plain stream from a DMA, which the size registers divide into frames."""

# No postponed annotations here: data.Struct reads its fields from them.
from amaranth import Array, Cat, Module, Mux, Signal, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MAX_FRAME_PX
from hdl.streams import COORDINATE, PixelPayload

GRAY_PER_WORD = 4


class VideoPayload(data.Struct):
    """A beat of the input stream.

    Members
    -------
    data : in video mode G, B, R from the lowest byte (UG934), or gray in the lowest; in memory mode R, G, B, X from
        the lowest byte, or four gray pixels, the first one lowest.
    first : TUSER[0], the start of a frame; ignored in memory mode.
    last : TLAST, the end of a line; in memory mode the end of a transfer.
    """

    data: unsigned(32)
    first: unsigned(1)
    last: unsigned(1)


class VideoInput(wiring.Component):
    """Converts the input stream to pixels with start-of-frame and end-of-line flags; up to one pixel a clock.

    A DMA marks neither frames nor lines, so memory mode counts them. A frame starts with the first beat after reset
    or after the previous frame; pixels left in a beat at the end of a frame are dropped. A transfer may hold several
    frames. If it ends in the middle of one, the count restarts: the next frame then starts cleanly, and frame
    admission flags the incomplete one.

    Members
    -------
    i : In(stream of VideoPayload)
        Its ready does not depend on its valid.
    i_enable : In(1)
        Accept pixels.
    i_memory_mode, i_gray_input, i_width_px, i_height_px : In
        May change only between frames.
    o : Out(stream of PixelPayload)

    Attributes
    ----------
    latency_cycles : int
    """

    i: stream.Interface
    i_enable: Signal
    i_memory_mode: Signal
    i_gray_input: Signal
    i_width_px: Signal
    i_height_px: Signal
    o: stream.Interface

    latency_cycles = 0

    def __init__(self) -> None:
        super().__init__(
            {
                "i": In(stream.Signature(VideoPayload)),
                "i_enable": In(1),
                "i_memory_mode": In(1),
                "i_gray_input": In(1),
                "i_width_px": In(range(MAX_FRAME_PX + 1)),
                "i_height_px": In(range(MAX_FRAME_PX + 1)),
                "o": Out(stream.Signature(PixelPayload)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Split beats into pixels; count columns and lines."""
        m = Module()
        beat, pixel = self.i.payload, self.o.payload
        x, y, last_x, last_y = (Signal(COORDINATE, name=name) for name in ("x", "y", "last_x", "last_y"))
        byte = Signal(range(GRAY_PER_WORD))
        unpacks, empties, line_ends, frame_ends = Signal(), Signal(), Signal(), Signal()
        m.d.sync += [last_x.eq(self.i_width_px - 1), last_y.eq(self.i_height_px - 1)]
        m.d.comb += [
            unpacks.eq(self.i_memory_mode & self.i_gray_input),
            line_ends.eq(x == last_x),
            frame_ends.eq(line_ends & (y == last_y)),
            empties.eq(~unpacks | frame_ends | (byte == GRAY_PER_WORD - 1)),
            self.o.valid.eq(self.i.valid & self.i_enable),
            self.i.ready.eq(self.o.ready & self.i_enable & empties),
            pixel.data.eq(beat.data),
            pixel.first.eq(beat.first),
            pixel.last.eq(beat.last),
        ]
        with m.If(self.i_memory_mode):
            lanes = [beat.data.word_select(n, 8) for n in range(GRAY_PER_WORD)]
            red, green, blue, _ = lanes
            # The front end takes colours in the order of UG934: G in the lowest byte, then B, R.
            m.d.comb += [
                pixel.data.eq(Mux(unpacks, Array(lanes)[byte], Cat(green, blue, red))),
                pixel.first.eq((x == 0) & (y == 0)),
                pixel.last.eq(line_ends),
            ]
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += [byte.eq(Mux(empties, 0, byte + 1)), x.eq(Mux(line_ends, 0, x + 1))]
            with m.If(line_ends):
                m.d.sync += y.eq(Mux(frame_ends, 0, y + 1))
            with m.If(empties & beat.last):
                m.d.sync += [x.eq(0), y.eq(0)]
        return m
