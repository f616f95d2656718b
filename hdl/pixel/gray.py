"""Gray from colour."""

from amaranth import Module, Mux, Signal, unsigned
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.pixel.gray import BLUE, GREEN, RED
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.weighted_sum import WeightedSum
from hdl.streams import add_submodules, beat, carry_scan, pixelwise


class Gray(Component):
    """``(77 R + 150 G + 29 B + 128) >> 8`` (thesis, equation IV-1), or the input unchanged where it is gray already."""

    i: data.View
    """Beats of ``data``, as in `hdl.streams.pixel_payload`."""
    i_gray_input: In(1)
    """The input is gray. Stable during a frame."""
    o: data.View
    """Beats of ``pixel``, 8 bits."""

    def __init__(self, *, pixels_per_clock: int = 1) -> None:
        self.pixels_per_clock = pixels_per_clock
        # In the order of the bytes on the bus: UG934 puts G lowest, then B, then R.
        weights = (GREEN, BLUE, RED)
        self._lumas = [WeightedSum(weights=weights, shape=unsigned(8)) for _ in range(pixels_per_clock)]
        self.latency_cycles = self._lumas[0].latency_cycles + 1
        super().__init__(i=In(beat(pixels_per_clock, data=24)), o=Out(beat(pixels_per_clock, pixel=8)))

    def elaborate(self, platform: object) -> Module:
        """Weighted sum; gray input bypasses it with the same delay."""
        m = Module()
        add_submodules(m, "luma", self._lumas)
        carry_scan(m, self.i, self.o, self.latency_cycles)
        pixels = pixelwise(self.pixels_per_clock, self.i.data, self.o.pixel)
        for luma, (color, o_pixel) in zip(self._lumas, pixels, strict=True):
            m.d.comb += luma.i_valid.eq(self.i.valid)
            m.d.comb += [channel.eq(color.word_select(n, 8)) for n, channel in enumerate(luma.i_values)]
            gray = delayed(m, color[:8], luma.latency_cycles)
            pixel = Signal(8, reset_less=True)
            m.d.sync += pixel.eq(Mux(self.i_gray_input, gray, (luma.o_sum + 128) >> 8))
            m.d.comb += o_pixel.eq(pixel)
        return m
