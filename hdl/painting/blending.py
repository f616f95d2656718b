"""Blends a frame's pixels into those of the canvas."""

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.blending import FADE, FADE_LOG2
from hdl.lib.delay import delayed
from hdl.lib.multiplier import Multiplier, multiply
from hdl.lib.result_queue import ResultQueue, queue_results
from hdl.painting.sampling import CHANNELS, PIXEL

PIXELS = data.StructLayout({"old": PIXEL, "new": PIXEL})
"""A pixel of the canvas, and the frame's pixel in its place."""
SHARE_CYCLES = 2
PIPELINE_CYCLES = SHARE_CYCLES + Multiplier.latency_cycles + 1


class Blending(wiring.Component):
    """New pixels of the canvas; equal to `golden_model.painting.blending.blend`.

    The throughput is one pixel per clock. Three multipliers.
    """

    i: In(stream.Signature(PIXELS))
    """Old pixels that do not matter are 0."""
    o: Out(stream.Signature(PIXEL))

    latency_cycles = PIPELINE_CYCLES + ResultQueue.latency_cycles
    """From two pixels to their blend, where none waits."""

    def elaborate(self, platform: object) -> Module:
        """Find the new pixel's share, then mix the colours."""
        m = Module()
        queue = queue_results(m, self.i, self.o, pipeline_cycles=PIPELINE_CYCLES)
        new, old = self.i.payload.new, self.i.payload.old
        share = self._share(m, old.weight, new.weight)
        weight = delayed(m, Mux(new.weight > old.weight, new.weight, old.weight), PIPELINE_CYCLES)
        result = data.View(PIXEL, queue.i_result)
        m.d.comb += result.weight.eq(weight)
        for n in range(CHANNELS):
            # Outside the frame the colour means nothing: in a simulation it may be X, and 0 times X is X.
            over = delayed(m, Mux(new.weight == 0, 0, new.colour[n]), SHARE_CYCLES)
            under = delayed(m, old.colour[n], SHARE_CYCLES)
            product = multiply(m, f"channel{n}", over - under, share)
            rounded = Cat(Const(FADE >> 1, FADE_LOG2), delayed(m, under, Multiplier.latency_cycles))
            mixed = delayed(m, (rounded + product)[FADE_LOG2:], 1)
            m.d.comb += result.colour[n].eq(mixed)
        return m

    @staticmethod
    def _share(m: Module, old: Value, new: Value) -> Signal:
        """The share of the frame's pixel in 1/16."""
        difference = delayed(m, new - old + (FADE >> 1), 1)
        is_outside = delayed(m, new == 0, 1)
        is_whole = delayed(m, old == 0, 1) | (difference > FADE)
        share = Signal(range(FADE + 1), reset_less=True)
        m.d.sync += share.eq(Mux(is_whole, FADE, difference))
        with m.If(is_outside | (~is_whole & (difference < 0))):
            m.d.sync += share.eq(0)
        return share
