"""Video ingress: pixels from AXI4-Stream video, or from the plain stream of a DMA."""

from amaranth import Array, Cat, Module, Mux, Signal
from amaranth.lib import data, stream
from amaranth.lib.wiring import In, Out

from hdl.build import pixels_per_clock
from hdl.lib.component import Component
from hdl.streams import each_pixel, pixel_payload

GRAY_PER_WORD = 4
DMA_BITS = 32
"""Width of an input whose beats are the words of a DMA."""


def video_payload(video_bits: int) -> data.StructLayout:
    """A beat of the input stream.

    Members
    -------
    data : in video mode G, B, R from the lowest byte (UG934), or gray in the lowest; in memory mode R, G, B, X from
        the lowest byte, or four gray pixels, the first one lowest. The upper bytes of a narrower port are 0. Of two
        pixels the left one is in the lower half of the port.
    first : TUSER[0], the start of a frame; ignored in memory mode.
    last : TLAST, the end of a line; in memory mode the end of a transfer.
    """
    # A single pixel always has 32 bits, so that blocks and test benches need no other type for narrower ports.
    bits = video_bits if pixels_per_clock(video_bits) > 1 else DMA_BITS
    return data.StructLayout({"data": bits, "first": 1, "last": 1})


VideoPayload = video_payload(DMA_BITS)
"""A beat of one pixel."""


class VideoInput(Component):
    """Converts the beats of the input stream to one or two pixels per clock.

    In memory mode, ``last`` of a pixel ends the transfer, and pixels left in a beat at the end of a frame are dropped.
    The path from input to output is combinational; the only state is the position in the beat.

    Parameters
    ----------
    video_bits : {32, 24, 8, 48, 16}
        Width of the port that the beats come from. Only a 32-bit beat holds more gray pixels in memory mode than in
        video mode. An 8 or 16-bit port has no colour. A beat of 48 or 16 bits holds two pixels; every line begins with
        a new beat in both modes, and the upper pixel of an odd line's last beat is ignored.

    Raises
    ------
    ValueError
        For another width.
    """

    i: stream.Interface
    """Stream of `video_payload`."""
    i_memory_mode: In(1)
    """1: memory mode, 0: video mode. May change only between frames."""
    i_gray_input: In(1)
    """1: gray, 0: colour. May change only between frames."""
    i_frame_ends: In(1)
    """The pixel at ``o`` is the last of its frame."""
    o: stream.Interface
    """Stream of `hdl.streams.pixel_payload`."""

    latency_cycles = 0

    def __init__(self, *, video_bits: int) -> None:
        self.pixels_per_clock = pixels_per_clock(video_bits)
        self.gray_per_beat = GRAY_PER_WORD if video_bits == DMA_BITS else 1
        super().__init__(
            i=In(stream.Signature(video_payload(video_bits))),
            o=Out(stream.Signature(pixel_payload(self.pixels_per_clock))),
        )

    def elaborate(self, platform: object) -> Module:
        """Split beats into pixels, and bring their colours into the front end's order."""
        m = Module()
        beat, pixel = self.i.payload, self.o.payload
        byte = Signal(range(GRAY_PER_WORD))
        unpacks = Signal()
        empties = Signal()
        m.d.comb += [
            unpacks.eq(self.i_memory_mode & self.i_gray_input),
            empties.eq(~unpacks | self.i_frame_ends | (byte == self.gray_per_beat - 1)),
            self.o.valid.eq(self.i.valid),
            self.i.ready.eq(self.o.ready & empties),
            pixel.first.eq(beat.first),
            # A beat of four gray pixels ends the line or transfer only with its last one.
            pixel.last.eq(beat.last & empties),
        ]
        pixel_bits = len(beat.data) // self.pixels_per_clock
        for n, color in enumerate(each_pixel(pixel.data, self.pixels_per_clock)):
            bits = beat.data[n * pixel_bits :][:pixel_bits]
            lanes = [bits[8 * lane : 8 * lane + 8] for lane in range(GRAY_PER_WORD)]
            red, green, blue, _ = lanes
            # The front end takes colours in the order of UG934: G in the lowest byte, then B, R.
            m.d.comb += color.eq(Mux(self.i_memory_mode, Cat(green, blue, red), bits))
            with m.If(unpacks):
                m.d.comb += color.eq(Array(lanes[: self.gray_per_beat])[byte])
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += byte.eq(Mux(empties, 0, byte + 1))
        return m
