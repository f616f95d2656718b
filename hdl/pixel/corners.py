"""Corner detection of a level: from columns of gray pixels to corner candidates."""

from __future__ import annotations

from typing import NamedTuple

from amaranth import Module, Mux, Signal
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import FrontEndConfig
from golden_model.formats import PIXEL, RESPONSE_CODE
from hdl.lib.delay import delayed
from hdl.pixel.fast import Fast
from hdl.pixel.gradients import GradientColumns
from hdl.pixel.harris import RawResponse, ResponseCode, StructureTensor
from hdl.pixel.nms import NEIGHBOURHOOD, Suppression
from hdl.streams import beat, carry_scan


class Stage(NamedTuple):
    """The hardware counterpart of a plane of `golden_model.front_end.trace`: a field of a beat, and its lag."""

    beat: data.View
    field: str
    lag_px: int


class Corners(wiring.Component):
    """Responses of the chosen detector, Harris or FAST, and their suppression.

    Both detectors are built; the one that is not chosen gets no valid beats, so that its registers hold still.

    Parameters
    ----------
    config : FrontEndConfig
        Its ``detector`` and ``threshold`` are ignored: they are set at run time.
    width_px : int
        Largest width of a line.

    Members
    -------
    i : In(beat(column))
        3 gray pixels, the newest line first.
    i_fast : In(1)
        1: FAST; 0: Harris. Stable during a frame.
    i_threshold_code : In(15)
        Smallest response code that survives. Stable during a frame.
    o : Out(beat(code, left, right, up, down))
        Corners, including unspecified ones near the border: the level removes those.

    Attributes
    ----------
    lag_px : int
    latency_cycles : int
    """

    i: data.View
    i_fast: Signal
    i_threshold_code: Signal
    o: data.View

    def __init__(self, *, config: FrontEndConfig, width_px: int) -> None:
        self._columns = GradientColumns(smoothed=config.smoothed_gradients, width_px=width_px)
        self._tensor = StructureTensor(window_px=config.tensor_window_px)
        self._raw_response = RawResponse(k_numerator=config.harris_k_numerator, k_shift=config.harris_k_shift)
        self._response_code = ResponseCode()
        self._fast = Fast()
        self._suppression = Suppression(radius_px=config.suppression_radius_px, width_px=width_px)
        self._harris = (self._tensor, self._raw_response, self._response_code)
        self._harris_cycles = sum(block.latency_cycles for block in self._harris)
        self._response_cycles = max(self._harris_cycles, self._fast.latency_cycles)
        self.response_lag_px = self._columns.gradient_lag_px + self._tensor.lag_px
        self.lag_px = self.response_lag_px + self._suppression.lag_px
        self.latency_cycles = self._columns.latency_cycles + self._response_cycles + self._suppression.latency_cycles
        super().__init__(
            {
                "i": In(beat(column=data.ArrayLayout(PIXEL.bits, 3))),
                "i_fast": In(1),
                "i_threshold_code": In(RESPONSE_CODE.bits),
                "o": Out(beat(**NEIGHBOURHOOD)),
            }
        )

    @property
    def stages(self) -> dict[str, Stage]:
        """The intermediate planes, under the names of `golden_model.front_end.trace`."""
        columns, lag_px = self._columns, self.response_lag_px
        smoothed = {"smoothed": Stage(columns.smooth.o, "pixel", columns.smooth.lag_px)} if columns.smooth else {}
        return {
            **smoothed,
            **{name: Stage(columns.sobel.o, name, columns.gradient_lag_px) for name in ("gradient_x", "gradient_y")},
            **{f"tensor_{name}": Stage(self._tensor.o, name, lag_px) for name in "abc"},
            "raw_response": Stage(self._raw_response.o, "raw", lag_px),
            "response_code": Stage(self._suppression.i, "code", lag_px),
        }

    def elaborate(self, platform: object) -> Module:
        """Both detectors side by side, the faster one delayed to the latency of the other; then suppression."""
        m = Module()
        m.submodules.columns = columns = self._columns
        m.submodules.tensor = tensor = self._tensor
        m.submodules.raw_response = raw_response = self._raw_response
        m.submodules.response_code = response_code = self._response_code
        m.submodules.fast = fast = self._fast
        m.submodules.suppression = suppression = self._suppression
        # The scan position goes to both, so that both have it; only the chosen detector gets valid beats.
        for detector, chosen in ((tensor, ~self.i_fast), (fast, self.i_fast)):
            carry_scan(m, columns.o, detector.i, 0)
            m.d.comb += detector.i.valid.eq(columns.o.valid & chosen)
        m.d.comb += [
            columns.i.eq(self.i),
            columns.i_fast.eq(self.i_fast),
            tensor.i.column.eq(columns.o.gradients),
            raw_response.i.eq(tensor.o),
            response_code.i.eq(raw_response.o),
            response_code.i_threshold_code.eq(self.i_threshold_code),
            fast.i.column.eq(columns.o.pixels),
            fast.i_threshold_code.eq(self.i_threshold_code),
            suppression.i_fast.eq(self.i_fast),
            self.o.eq(suppression.o),
        ]
        harris_code = delayed(m, response_code.o.code, self._response_cycles - self._harris_cycles)
        fast_code = delayed(m, fast.o.code, self._response_cycles - fast.latency_cycles)
        # Not taken from a detector: the one that rests has no valid beats.
        carry_scan(m, columns.o, suppression.i, self._response_cycles)
        m.d.comb += suppression.i.code.eq(Mux(self.i_fast, fast_code, harris_code))
        return m
