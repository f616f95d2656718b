"""Columns of gradients for Harris, or of gray pixels for FAST, from shared line memories."""

from collections.abc import Iterator

from amaranth import Cat, Module, Mux, Value
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.formats import PIXEL
from hdl.lib.component import Component
from hdl.lib.delay import Pipe, check_aligned, delayed
from hdl.pixel.harris import GRADIENTS, TENSOR_LINES
from hdl.pixel.smooth import Binomial
from hdl.pixel.sobel import Sobel
from hdl.pixel.window import LineBuffer
from hdl.streams import beat, carry_scan, pixel_beats

PASSED_LAG_PX = 1
"""What the smoother passes for FAST is one line and one column behind the newest pixel."""


class GradientColumns(Component):
    """Columns of gradients for Harris or of gray pixels for FAST, from the same line memories.

    Sharing saves FAST's own line memories. While FAST is chosen, the smoother passes its middle pixel unchanged, and
    each entry of the gradient lines stores two pixels instead of a gradient: a pixel and the one two lines above it.
    The pairs cover two lines more than the gradients, which are enough for FAST.

    Parameters
    ----------
    smoothed : bool
        Apply the 3x3 binomial before the gradients.
    width_px : int
        Largest width of a line.
    """

    i: data.View
    """Beats of ``column``: 3 gray pixels, the newest line first."""
    i_fast: In(1)
    """FAST is chosen. Stable during a frame."""
    o: data.View
    """Beats of ``gradients`` (`hdl.pixel.harris.GRADIENTS` of `TENSOR_LINES`) and ``pixels`` (of ``pixel_lines``), the
    newest line first. Only those of the chosen detector are meaningful."""

    smooth: Binomial | None
    sobel: Sobel
    pixel_lines = TENSOR_LINES + 2
    gradient_lag_px: int
    """Lag of the newest line."""
    pixel_lag_px: int
    """Lag of the newest line."""

    def __init__(self, *, smoothed: bool, width_px: int, pixels_per_clock: int = 1) -> None:
        self.pixels_per_clock = pixels_per_clock
        rate = {"pixels_per_clock": pixels_per_clock}
        self.smooth = Binomial(window_px=3, **rate) if smoothed else None
        self.sobel = Sobel(**rate)
        self.pixel_lag_px = self.smooth.lag_px if self.smooth else 0
        self.gradient_lag_px = self.pixel_lag_px + self.sobel.lag_px
        self._lines = LineBuffer(shape=GRADIENTS, lines=TENSOR_LINES - 1, width_px=width_px, **rate)
        self.latency_cycles = self.sobel.latency_cycles + self._lines.latency_cycles
        if self.smooth:
            check_aligned("lag_px of the gray", smoothed=self.smooth.lag_px, passed=PASSED_LAG_PX)
            self._smoothed_lines = LineBuffer(shape=PIXEL.bits, lines=2, width_px=width_px, **rate)
            self.latency_cycles += self.smooth.latency_cycles + self._smoothed_lines.latency_cycles
        super().__init__(
            i=In(beat(pixels_per_clock, column=data.ArrayLayout(PIXEL.bits, 3))),
            o=Out(
                beat(
                    pixels_per_clock,
                    gradients=data.ArrayLayout(GRADIENTS, TENSOR_LINES),
                    pixels=data.ArrayLayout(PIXEL.bits, self.pixel_lines),
                )
            ),
        )

    def elaborate(self, platform: object) -> Module:
        """Smooth, take gradients and store them; or store the pixels."""
        m = Module()
        column = self._smooth_column(m, self.smooth) if self.smooth else self.i
        m.submodules.sobel = sobel = self.sobel
        m.submodules.lines = lines = self._lines
        m.d.comb += sobel.i.eq(column)
        carry_scan(m, sobel.o, lines.i, 0)
        for above, gradient, stored in self._pixelwise(column, sobel.o, lines.i):
            gradients = Cat(gradient.gradient_x, gradient.gradient_y)
            # Two pixels of 8 bits fit the 22 bits of a gradient.
            pair = delayed(m, Cat(above.column[0], above.column[2]), sobel.latency_cycles)
            m.d.comb += Value.cast(stored.pixel).eq(Mux(self.i_fast, pair, gradients))

        carry_scan(m, lines.o, self.o, 0)
        for kept, out in self._pixelwise(lines.o, self.o):
            pairs = [Value.cast(pixel) for pixel in kept.column]
            # The pair of an entry is two lines apart: the last two entries also hold the two oldest lines.
            oldest = [pair >> PIXEL.bits for pair in pairs[-2:]]
            m.d.comb += out.gradients.eq(kept.column)
            m.d.comb += [pixel.eq(source) for pixel, source in zip(out.pixels, [*pairs, *oldest], strict=True)]
        return m

    def _smooth_column(self, m: Module, smooth: Binomial) -> data.View:
        """Store the smoothed pixels, or, for FAST, the middle of the smoother's window; return their column."""
        m.submodules.smooth = smooth
        m.submodules.smoothed_lines = lines = self._smoothed_lines
        m.d.comb += smooth.i.eq(self.i)
        carry_scan(m, smooth.o, lines.i, 0)
        # The middle of the window is a pixel further left: in this beat, or in the last one, which the pipe has kept.
        middles = [above.column[1] for above in pixel_beats(self.i, self.pixels_per_clock)]
        middle = Pipe(m, self.i.valid).registered(middles[-1], 0)
        for left, (smoothed, stored) in zip([middle, *middles], self._pixelwise(smooth.o, lines.i), strict=False):
            passed = delayed(m, left, smooth.latency_cycles)
            m.d.comb += stored.pixel.eq(Mux(self.i_fast, passed, smoothed.pixel))
        return lines.o

    def _pixelwise(self, *beats: data.View) -> Iterator[tuple[data.View, ...]]:
        return zip(*(pixel_beats(each, self.pixels_per_clock) for each in beats), strict=True)
