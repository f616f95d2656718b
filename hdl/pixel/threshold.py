"""The adaptive threshold: steady feature counts without a division."""

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
        A larger count counts as this.

    Members
    -------
    i_detector : In(1)
        Index into `golden_model.config.DETECTORS`. Static within a frame.
    i_load : In(1)
        Take ``i_code``.
    i_code : In(15)
    i_added : In(2)
        Features that this clock adds to the frame's.
    i_frame_ends : In(1)
        Begin a new count.
    i_adapt : In(1)
        With ``i_frame_ends``: move. The count must have been complete ``latency_cycles`` before.
    i_target : In(13)
        Features wanted.
    o_code : Out(15)
        The threshold.

    Attributes
    ----------
    latency_cycles : int
        From the last feature to the end of its frame, at least.
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
        """Count, excess, step, sum, each clamped: a clock for the comparison, one for the choice."""
        m = Module()
        added = delayed(m, self.i_added, 1, reset_less=False)
        # Once the highest bit is set, the count is more than enough, and rests.
        count = Signal(self.max_features.bit_length() + 1)
        with m.If(self.i_frame_ends):
            m.d.sync += count.eq(0)
        with m.Elif(~count[-1]):
            m.d.sync += count.eq(count + added)
        excess = delayed(m, _clamped(m, count, 0, self.max_features) - self.i_target, 1)
        steps = [STEPS[detector] for detector in DETECTORS]
        step = Array(_clamped(m, excess >> each.shift, -each.largest, each.largest) for each in steps)[self.i_detector]
        moved = delayed(m, self.o_code + delayed(m, step, 1), 1)
        following = delayed(m, Array(_clamped(m, moved, 1, each.max_code) for each in steps)[self.i_detector], 1)
        with m.If(self.i_load):
            m.d.sync += self.o_code.eq(self.i_code)
        with m.Elif(self.i_frame_ends & self.i_adapt):
            m.d.sync += self.o_code.eq(following)
        return m


def _clamped(m: Module, value: Value, low: int, high: int) -> Value:
    """The value of the clock before, moved into the range."""
    below, above = delayed(m, value < low, 1), delayed(m, value > high, 1)
    return Mux(below, low, Mux(above, high, delayed(m, value, 1)))
