"""The adaptive threshold: keeps the number of features steady, without a division."""

from amaranth import Array, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import DETECTORS
from golden_model.formats import RESPONSE_CODE
from golden_model.pixel.threshold import STEPS
from hdl.lib.delay import delayed
from hdl.settings import SETTINGS


class AdaptiveThreshold(wiring.Component):
    """Counts a frame's features and moves the threshold at its end (`golden_model.pixel.threshold.next_code`).

    Parameters
    ----------
    max_features : int
        Larger counts are limited to this.
    """

    i_detector: In(range(len(DETECTORS)))
    """Index into `golden_model.config.DETECTORS`. Stable during a frame."""
    i_load: In(1)
    """Set the threshold to ``i_code``."""
    i_code: In(RESPONSE_CODE.bits)
    """A response code."""
    i_added: In(range(3))
    """Features added to the frame's count in this clock."""
    i_frame_ends: In(1)
    """The frame ends: start a new count."""
    i_adapt: In(1)
    """With ``i_frame_ends``: adapt the threshold. The count must be complete ``latency_cycles`` before."""
    i_target: In(SETTINGS["target_features"].bits)
    """Target number of features per frame."""
    o_code: Out(RESPONSE_CODE.bits)
    """The threshold as a response code."""

    latency_cycles = 9
    """Smallest distance from the last feature to the end of its frame."""

    def __init__(self, *, max_features: int) -> None:
        self.max_features = max_features
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Count, excess, step and sum, each clamped within two clocks: one to compare, one to choose."""
        m = Module()
        # Registered, because it is the sum over the levels.
        added = delayed(m, self.i_added, 1, reset_less=False)
        # The highest bit means more than `max_features`: the count stops there, so that it cannot wrap around.
        count = Signal(self.max_features.bit_length() + 1)
        with m.If(self.i_frame_ends):
            m.d.sync += count.eq(0)
        with m.Elif(~count[-1]):
            m.d.sync += count.eq(count + added)
        excess = delayed(m, _clamp(m, count, 0, self.max_features) - self.i_target, 1)
        steps = [STEPS[detector] for detector in DETECTORS]
        by_detector = Array(_clamp(m, excess >> each.shift, -each.max_step, each.max_step) for each in steps)
        step = by_detector[self.i_detector]
        moved = delayed(m, self.o_code + delayed(m, step, 1), 1)
        following = delayed(m, Array(_clamp(m, moved, 1, each.max_code) for each in steps)[self.i_detector], 1)
        with m.If(self.i_load):
            m.d.sync += self.o_code.eq(self.i_code)
        with m.Elif(self.i_frame_ends & self.i_adapt):
            m.d.sync += self.o_code.eq(following)
        return m


def _clamp(m: Module, value: Value, low: int, high: int) -> Value:
    """``value`` one clock later, limited to ``low``..``high``."""
    below = delayed(m, value < low, 1)
    above = delayed(m, value > high, 1)
    return Mux(below, low, Mux(above, high, delayed(m, value, 1)))
