"""Columns of gradients for Harris, or of gray pixels for FAST, from shared line memories."""

from __future__ import annotations

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.formats import PIXEL
from hdl.lib.delay import Pipe, delayed
from hdl.pixel.fast import WINDOW_PX
from hdl.pixel.harris import GRADIENTS, TENSOR_LINES
from hdl.pixel.smooth import Binomial
from hdl.pixel.sobel import Sobel
from hdl.pixel.window import LineBuffer
from hdl.streams import beat, carry_scan


class GradientColumns(wiring.Component):
    """Columns of gradients for Harris or of gray pixels for FAST, from the same line memories.

    Sharing saves FAST's own line memories. While FAST is chosen, the smoother passes its middle pixel unchanged, and
    each entry of the gradient lines stores two pixels instead of a gradient: a pixel and the one two lines above it.
    Five such pairs cover the seven lines that FAST needs.

    Parameters
    ----------
    smoothed : bool
        Apply the 3x3 binomial before the gradients.
    width_px : int
        Largest width of a line.

    Members
    -------
    i : In(beat(column))
        3 gray pixels, the newest line first.
    i_fast : In(1)
        FAST is chosen. Stable during a frame.
    o : Out(beat(gradients, pixels))
        `hdl.pixel.harris.GRADIENTS` of 5 lines, or pixels of 7 lines, the newest line first. Only those of the chosen
        detector are meaningful.

    Attributes
    ----------
    smooth : Binomial or None
    sobel : Sobel
    gradient_lag_px, pixel_lag_px : int
        Lag of the newest line.
    latency_cycles : int
    """

    i: data.View
    i_fast: Signal
    o: data.View

    def __init__(self, *, smoothed: bool, width_px: int) -> None:
        self.smooth = Binomial(window_px=3) if smoothed else None
        self.sobel = Sobel()
        self.pixel_lag_px = self.smooth.lag_px if self.smooth else 0
        self.gradient_lag_px = self.pixel_lag_px + self.sobel.lag_px
        self._lines = LineBuffer(shape=GRADIENTS, lines=TENSOR_LINES - 1, width_px=width_px)
        self.latency_cycles = self.sobel.latency_cycles + self._lines.latency_cycles
        if self.smooth:
            self._smoothed_lines = LineBuffer(shape=PIXEL.bits, lines=2, width_px=width_px)
            self.latency_cycles += self.smooth.latency_cycles + self._smoothed_lines.latency_cycles
        super().__init__(
            {
                "i": In(beat(column=data.ArrayLayout(PIXEL.bits, 3))),
                "i_fast": In(1),
                "o": Out(
                    beat(
                        gradients=data.ArrayLayout(GRADIENTS, TENSOR_LINES),
                        pixels=data.ArrayLayout(PIXEL.bits, WINDOW_PX),
                    )
                ),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Smooth, take gradients and store them; or store the pixels."""
        m = Module()
        column = self._smoothed(m, self.smooth) if self.smooth else self.i
        m.submodules.sobel = sobel = self.sobel
        m.submodules.lines = lines = self._lines
        m.d.comb += sobel.i.eq(column)
        carry_scan(m, sobel.o, lines.i, 0)
        gradients = Cat(sobel.o.gradient_x, sobel.o.gradient_y)
        pair = delayed(m, Cat(column.column[0], column.column[2]), sobel.latency_cycles)
        m.d.comb += Value.cast(lines.i.pixel).eq(Mux(self.i_fast, pair, gradients))

        carry_scan(m, lines.o, self.o, 0)
        pairs = [Value.cast(pixel) for pixel in lines.o.column]
        # The pair of an entry is two lines apart: the last two entries also hold the two oldest lines.
        oldest = [pair >> PIXEL.bits for pair in pairs[TENSOR_LINES - 2 :]]
        m.d.comb += self.o.gradients.eq(lines.o.column)
        m.d.comb += [pixel.eq(source) for pixel, source in zip(self.o.pixels, [*pairs, *oldest], strict=True)]
        return m

    def _smoothed(self, m: Module, smooth: Binomial) -> data.View:
        """The column of smoothed pixels, or, for FAST, of the pixels in the middle of the smoother's window."""
        m.submodules.smooth = smooth
        m.submodules.smoothed_lines = lines = self._smoothed_lines
        m.d.comb += smooth.i.eq(self.i)
        carry_scan(m, smooth.o, lines.i, 0)
        # In the pipe, the register holds still without a beat like those of the smoother.
        middle = Pipe(m, self.i.valid).registered(self.i.column[1], 0)
        passed = delayed(m, middle, smooth.latency_cycles)
        m.d.comb += lines.i.pixel.eq(Mux(self.i_fast, passed, smooth.o.pixel))
        return lines.o
