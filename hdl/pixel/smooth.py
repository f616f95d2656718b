"""Binomial smoothing: 3x3 ahead of the gradients, 5x5 ahead of the descriptor."""

from math import comb

from amaranth import Module, Signal, unsigned
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.config import check_choice
from hdl.lib.component import Component
from hdl.pixel.window import SeparableSum
from hdl.streams import beat, carry_scan, pixelwise


class Binomial(Component):
    """``[1 2 1]`` or ``[1 4 6 4 1]`` in x and y, divided by 16 or 256 with halves rounded up.

    Parameters
    ----------
    window_px : {1, 3, 5}
        1 passes the pixels unchanged.
    """

    i: data.View
    """Beats of ``column``: ``window_px`` pixels, the newest line first."""
    o: data.View
    """Beats of ``pixel``."""

    def __init__(self, *, window_px: int, pixels_per_clock: int = 1) -> None:
        check_choice("window_px", window_px, (1, 3, 5))
        self.window_px = window_px
        self.pixels_per_clock = pixels_per_clock
        self.lag_px = window_px // 2
        weights = tuple(comb(window_px - 1, n) for n in range(window_px))
        self._sum = SeparableSum(
            vertical=weights, horizontal=weights, shape=unsigned(8), pixels_per_clock=pixels_per_clock
        )
        self.latency_cycles = self._sum.latency_cycles + 1
        super().__init__(
            i=In(beat(pixels_per_clock, column=data.ArrayLayout(8, window_px))), o=Out(beat(pixels_per_clock, pixel=8))
        )

    def elaborate(self, platform: object) -> Module:
        """Weighted sum over the window, then rounding."""
        m = Module()
        m.submodules.sum = weighted = self._sum
        m.d.comb += weighted.i.eq(self.i)
        carry_scan(m, weighted.o, self.o, 1)
        shift = 2 * (self.window_px - 1)
        for total, o_pixel in pixelwise(self.pixels_per_clock, weighted.o.sum, self.o.pixel):
            pixel = Signal(8, reset_less=True)
            # Keeps its value between beats, which saves power and simulation time.
            with m.If(weighted.o.valid):
                m.d.sync += pixel.eq((total + (1 << shift >> 1)) >> shift)
            m.d.comb += o_pixel.eq(pixel)
        return m
