"""Gray from colour."""

from __future__ import annotations

from amaranth import Module, Mux, Signal, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.pixel.gray import BLUE, GREEN, RED
from hdl.lib.delay import delayed
from hdl.lib.weighted_sum import WeightedSum
from hdl.streams import beat, carry_scan


class Gray(wiring.Component):
    """``(77 R + 150 G + 29 B + 128) >> 8`` (thesis, equation IV-1), or the input itself where it is gray already.

    Members
    -------
    i : In(beat(data))
        `hdl.streams.PixelPayload.data`.
    i_gray_input : In(1)
        The input is gray. Stable during a frame.
    o : Out(beat(pixel))

    Attributes
    ----------
    latency_cycles : int
    """

    i: data.View
    i_gray_input: Signal
    o: data.View

    def __init__(self) -> None:
        # In the order of the bytes on the bus: UG934 puts G lowest, then B, then R.
        self._luma = WeightedSum(weights=(GREEN, BLUE, RED), shape=unsigned(8))
        self.latency_cycles = self._luma.latency_cycles + 1
        super().__init__({"i": In(beat(data=24)), "i_gray_input": In(1), "o": Out(beat(pixel=8))})

    def elaborate(self, platform: object) -> Module:
        """Weighted sum; gray input bypasses it with the same delay."""
        m = Module()
        m.submodules.luma = luma = self._luma
        carry_scan(m, self.i, self.o, self.latency_cycles)
        m.d.comb += luma.i_valid.eq(self.i.valid)
        m.d.comb += [channel.eq(self.i.data.word_select(n, 8)) for n, channel in enumerate(luma.i_values)]
        gray = delayed(m, self.i.data[:8], luma.latency_cycles)
        pixel = Signal(8, reset_less=True)
        m.d.sync += pixel.eq(Mux(self.i_gray_input, gray, (luma.o_sum + 128) >> 8))
        m.d.comb += self.o.pixel.eq(pixel)
        return m
