"""Video ingress: pixels from AXI4-Stream video, or from the plain stream of a DMA."""

# No postponed annotations here: data.Struct reads its fields from them.
from amaranth import Array, Cat, Module, Mux, Signal, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.streams import PixelPayload

GRAY_PER_WORD = 4
VIDEO_BITS = (32, 24, 8)
"""Widths of the input's data: 24 and 8 are those of UG934 for RGB and gray, 32 is that of a DMA's words."""


class VideoPayload(data.Struct):
    """A beat of the input stream.

    Members
    -------
    data : in video mode G, B, R from the lowest byte (UG934), or gray in the lowest; in memory mode R, G, B, X from
        the lowest byte, or four gray pixels, the first one lowest. The upper bytes of a narrower port are 0.
    first : TUSER[0], the start of a frame; ignored in memory mode.
    last : TLAST, the end of a line; in memory mode the end of a transfer.
    """

    data: unsigned(32)
    first: unsigned(1)
    last: unsigned(1)


class VideoInput(wiring.Component):
    """Converts the beats of the input stream to pixels, up to one a clock.

    In memory mode, ``last`` of a pixel ends the transfer, and pixels left in a beat at the end of a frame are dropped.
    The path from input to output is combinational; between pixels only the byte of the beat is kept.

    Parameters
    ----------
    video_bits : {32, 24, 8}
        Width of the port that the beats come from. A beat of fewer than 32 bits holds one gray pixel in memory mode,
        too; with 8 bits there is no colour.

    Members
    -------
    i : In(stream of VideoPayload)
    i_memory_mode, i_gray_input : In(1)
        May change only between frames.
    i_frame_ends : In(1)
        The pixel at ``o`` is the last of its frame.
    o : Out(stream of PixelPayload)

    Attributes
    ----------
    latency_cycles : int

    Raises
    ------
    ValueError
        For another width.
    """

    i: stream.Interface
    i_memory_mode: Signal
    i_gray_input: Signal
    i_frame_ends: Signal
    o: stream.Interface

    latency_cycles = 0

    def __init__(self, *, video_bits: int = VIDEO_BITS[0]) -> None:
        if video_bits not in VIDEO_BITS:
            raise ValueError(f"video_bits is {video_bits}; it must be one of {', '.join(map(str, VIDEO_BITS))}")
        self.gray_per_beat = GRAY_PER_WORD if video_bits == VIDEO_BITS[0] else 1
        super().__init__(
            {
                "i": In(stream.Signature(VideoPayload)),
                "i_memory_mode": In(1),
                "i_gray_input": In(1),
                "i_frame_ends": In(1),
                "o": Out(stream.Signature(PixelPayload)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Split beats into pixels, and bring their colours into one order."""
        m = Module()
        beat, pixel = self.i.payload, self.o.payload
        byte = Signal(range(GRAY_PER_WORD))
        unpacks = Signal()
        empties = Signal()
        lanes = [beat.data.word_select(n, 8) for n in range(GRAY_PER_WORD)]
        red, green, blue, _ = lanes
        m.d.comb += [
            unpacks.eq(self.i_memory_mode & self.i_gray_input),
            empties.eq(~unpacks | self.i_frame_ends | (byte == self.gray_per_beat - 1)),
            self.o.valid.eq(self.i.valid),
            self.i.ready.eq(self.o.ready & empties),
            # The front end takes colours in the order of UG934: G in the lowest byte, then B, R.
            pixel.data.eq(Mux(self.i_memory_mode, Cat(green, blue, red), beat.data)),
            pixel.first.eq(beat.first),
            pixel.last.eq(beat.last & empties),
        ]
        with m.If(unpacks):
            m.d.comb += pixel.data.eq(Array(lanes)[byte])
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += byte.eq(Mux(empties, 0, byte + 1))
        return m
