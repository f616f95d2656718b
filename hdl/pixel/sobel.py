"""Sobel gradients."""

from amaranth import Module, signed, unsigned
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.formats import GRADIENT
from hdl.lib.component import Component
from hdl.pixel.window import SeparableSum
from hdl.streams import beat, carry_scan

SMOOTH = (1, 2, 1)
DERIVE = (1, 0, -1)
"""Weights, newest pixel first: the rightmost or the lowest."""


class Sobel(Component):
    """Horizontal and vertical 3x3 gradients, positive where the image brightens to the right and downwards."""

    i: data.View
    """Beats of ``column``: 3 pixels, the newest line first."""
    o: data.View
    """Beats of ``gradient_x`` and ``gradient_y``, `golden_model.formats.GRADIENT`."""

    lag_px = 1

    def __init__(self, *, pixels_per_clock: int = 1) -> None:
        self.pixels_per_clock = pixels_per_clock
        self._along_x, self._along_y = (
            SeparableSum(vertical=down, horizontal=along, shape=unsigned(8), pixels_per_clock=pixels_per_clock)
            for down, along in ((SMOOTH, DERIVE), (DERIVE, SMOOTH))
        )
        self.latency_cycles = self._along_x.latency_cycles
        gradient = signed(GRADIENT.bits)
        super().__init__(
            i=In(beat(pixels_per_clock, column=data.ArrayLayout(8, 3))),
            o=Out(beat(pixels_per_clock, gradient_x=gradient, gradient_y=gradient)),
        )

    def elaborate(self, platform: object) -> Module:
        """One separable sum per direction."""
        m = Module()
        m.submodules.along_x, m.submodules.along_y = self._along_x, self._along_y
        m.d.comb += [
            self._along_x.i.eq(self.i),
            self._along_y.i.eq(self.i),
            self.o.gradient_x.eq(self._along_x.o.sum),
            self.o.gradient_y.eq(self._along_y.o.sum),
        ]
        # The same two sums in either order take the same time: either could give the scan position.
        carry_scan(m, self._along_x.o, self.o, 0)
        return m
