"""The adaptive threshold: keeps the number of features steady, without a division."""

from __future__ import annotations

from amaranth import Array, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import DETECTORS
from golden_model.formats import RESPONSE_CODE
from golden_model.pixel.threshold import STEPS
from hdl.lib.delay import delayed


class AdaptiveThreshold(wiring.Component):
    """Counts a frame's features and moves the threshold at its end (`golden_model.pixel.threshold.next_code`).

    Parameters
    ----------
    max_features : int
        Larger counts are limited to this.

    Members
    -------
    i_detector : In(1)
        Index into `golden_model.config.DETECTORS`. Stable during a frame.
    i_load : In(1)
        Set the threshold to ``i_code``.
    i_code : In(15)
        A response code.
    i_added : In(2)
        Features added to the frame's count in this clock.
    i_frame_ends : In(1)
        The frame ends: start a new count.
    i_adapt : In(1)
        With ``i_frame_ends``: adapt the threshold. The count must be complete ``latency_cycles`` before.
    i_target : In(13)
        Features wanted.
    o_code : Out(15)
        The threshold as a response code.

    Attributes
    ----------
    latency_cycles : int
        Smallest distance from the last feature to the end of its frame.
    """

    i_detector: Signal
    i_load: Signal
    i_code: Signal
    i_added: Signal
    i_frame_ends: Signal
    i_adapt: Signal
    i_target: Signal
    o_code: Signal

    latency_cycles = 9

    def __init__(self, *, max_features: int) -> None:
        self.max_features = max_features
        super().__init__(
            {
                "i_detector": In(range(len(DETECTORS))),
                "i_load": In(1),
                "i_code": In(RESPONSE_CODE.bits),
                "i_added": In(range(3)),
                "i_frame_ends": In(1),
                "i_adapt": In(1),
                "i_target": In(13),
                "o_code": Out(RESPONSE_CODE.bits),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Count, excess, step and sum, each clamped in two clocks: one to compare, one to choose."""
        m = Module()
        # Registered, because it is the sum over the levels.
        added = delayed(m, self.i_added, 1, reset_less=False)
        # The highest bit means more than `max_features`: the count stops there, so that it cannot wrap around.
        count = Signal(self.max_features.bit_length() + 1)
        with m.If(self.i_frame_ends):
            m.d.sync += count.eq(0)
        with m.Elif(~count[-1]):
            m.d.sync += count.eq(count + added)
        excess = delayed(m, _clamped(m, count, 0, self.max_features) - self.i_target, 1)
        steps = [STEPS[detector] for detector in DETECTORS]
        by_detector = Array(_clamped(m, excess >> each.shift, -each.max_step, each.max_step) for each in steps)
        step = by_detector[self.i_detector]
        moved = delayed(m, self.o_code + delayed(m, step, 1), 1)
        following = delayed(m, Array(_clamped(m, moved, 1, each.max_code) for each in steps)[self.i_detector], 1)
        with m.If(self.i_load):
            m.d.sync += self.o_code.eq(self.i_code)
        with m.Elif(self.i_frame_ends & self.i_adapt):
            m.d.sync += self.o_code.eq(following)
        return m


def _clamped(m: Module, value: Value, low: int, high: int) -> Value:
    """The value of the clock before, limited to ``low``..``high``."""
    below = delayed(m, value < low, 1)
    above = delayed(m, value > high, 1)
    return Mux(below, low, Mux(above, high, delayed(m, value, 1)))
