"""Corner detection of a level: from columns of gray pixels to corner candidates."""

from typing import NamedTuple

from amaranth import Module, Mux
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.config import FrontEndConfig
from golden_model.formats import PIXEL, RESPONSE_CODE
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.pixel.fast import Fast
from hdl.pixel.gradients import GradientColumns
from hdl.pixel.harris import RawResponse, ResponseCode, StructureTensor
from hdl.pixel.nms import NEIGHBOURHOOD, Suppression
from hdl.streams import add_submodules, beat, carry_scan, each_pixel, pixel_beats, pixelwise


class Stage(NamedTuple):
    """The hardware's counterpart of a plane of `golden_model.front_end.trace`: a field of beats, and its lag.

    There is one beat per pixel of a clock.
    """

    beats: list[data.View]
    field: str
    lag_px: int


class Corners(Component):
    """Responses of the chosen detector, Harris or FAST, and their suppression.

    Both detectors are built; the one that is not chosen gets no valid beats, so that its registers hold still.

    Parameters
    ----------
    config : FrontEndConfig
        Its ``detector`` and ``threshold`` are ignored: they are set at run time.
    width_px : int
        Largest width of a line.
    """

    i: data.View
    """Beats of ``column``: 3 gray pixels, the newest line first."""
    i_fast: In(1)
    """1: FAST; 0: Harris. Stable during a frame."""
    i_threshold_code: In(RESPONSE_CODE.bits)
    """Smallest response code that survives. Stable during a frame."""
    o: data.View
    """Beats of `hdl.pixel.nms.NEIGHBOURHOOD`: corners, including unspecified ones near the border, which the level
    removes."""

    def __init__(self, *, config: FrontEndConfig, width_px: int, pixels_per_clock: int = 1) -> None:
        self.pixels_per_clock = pixels_per_clock
        rate, k = {"pixels_per_clock": pixels_per_clock}, (config.harris_k_numerator, config.harris_k_shift)
        # One line memory serves both detectors.
        self._columns = GradientColumns(smoothed=config.smoothed_gradients, width_px=width_px, **rate)
        self._tensor = StructureTensor(window_px=config.tensor_window_px, **rate)
        self._raw_responses = [RawResponse(k_numerator=k[0], k_shift=k[1]) for _ in range(pixels_per_clock)]
        self._response_codes = [ResponseCode() for _ in range(pixels_per_clock)]
        self._suppression = Suppression(radius_px=config.suppression_radius_px, width_px=width_px, **rate)
        # Both detectors describe the same pixel: FAST's window lies as far up and left as Harris's needs it.
        self.response_lag_px = self._columns.gradient_lag_px + self._tensor.lag_px
        self._fast = Fast(lag_px=self.response_lag_px - self._columns.pixel_lag_px, **rate)
        needed, stored = self._fast.lines, self._columns.pixel_lines
        if needed > stored:
            raise ValueError(f"FAST needs {needed} lines of pixels, but {stored} are stored")
        harris = (self._tensor, self._raw_responses[0], self._response_codes[0])
        self._harris_cycles = sum(block.latency_cycles for block in harris)
        self._response_cycles = max(self._harris_cycles, self._fast.latency_cycles)
        self.lag_px = self.response_lag_px + self._suppression.lag_px
        self.latency_cycles = self._columns.latency_cycles + self._response_cycles + self._suppression.latency_cycles
        super().__init__(
            i=In(beat(pixels_per_clock, column=data.ArrayLayout(PIXEL.bits, 3))),
            o=Out(beat(pixels_per_clock, **NEIGHBOURHOOD)),
        )

    @property
    def stages(self) -> dict[str, Stage]:
        """Intermediate planes, by their names in `golden_model.front_end.trace`."""
        columns, lag_px = self._columns, self.response_lag_px
        gradients = pixel_beats(columns.sobel.o, self.pixels_per_clock)
        tensors = pixel_beats(self._tensor.o, self.pixels_per_clock)
        codes = pixel_beats(self._suppression.i, self.pixels_per_clock)
        smooth = columns.smooth
        smoothed = pixel_beats(smooth.o, self.pixels_per_clock) if smooth else []
        return {
            **({"smoothed": Stage(smoothed, "pixel", smooth.lag_px)} if smooth else {}),
            **{name: Stage(gradients, name, columns.gradient_lag_px) for name in ("gradient_x", "gradient_y")},
            **{f"tensor_{name}": Stage(tensors, name, lag_px) for name in "abc"},
            "raw_response": Stage([block.o for block in self._raw_responses], "raw", lag_px),
            "response_code": Stage(codes, "code", lag_px),
        }

    def elaborate(self, platform: object) -> Module:
        """Both detectors side by side, the faster one delayed to the other's latency; then suppression."""
        m = Module()
        m.submodules.columns = columns = self._columns
        m.submodules.tensor = tensor = self._tensor
        add_submodules(m, "raw_response", self._raw_responses)
        add_submodules(m, "response_code", self._response_codes)
        m.submodules.fast = fast = self._fast
        m.submodules.suppression = suppression = self._suppression
        # The scan position goes to both, so that both have it; only the chosen detector gets valid beats.
        for detector, chosen in ((tensor, ~self.i_fast), (fast, self.i_fast)):
            carry_scan(m, columns.o, detector.i, 0)
            m.d.comb += detector.i.valid.eq(columns.o.valid & chosen)
        m.d.comb += [columns.i.eq(self.i), columns.i_fast.eq(self.i_fast), tensor.i.column.eq(columns.o.gradients)]
        tensors = pixel_beats(tensor.o, self.pixels_per_clock)
        harris = zip(tensors, self._raw_responses, self._response_codes, strict=True)
        for pixel_tensor, raw_response, response_code in harris:
            m.d.comb += [
                raw_response.i.eq(pixel_tensor),
                response_code.i.eq(raw_response.o),
                response_code.i_threshold_code.eq(self.i_threshold_code),
            ]
        m.d.comb += [
            fast.i_threshold_code.eq(self.i_threshold_code),
            suppression.i_fast.eq(self.i_fast),
            self.o.eq(suppression.o),
        ]
        for i_column, column in pixelwise(self.pixels_per_clock, fast.i.column, columns.o.pixels):
            m.d.comb += [pixel.eq(column[n]) for n, pixel in enumerate(i_column)]
        harris_wait = self._response_cycles - self._harris_cycles
        fast_wait = self._response_cycles - fast.latency_cycles
        chosen_codes = []
        for block, score in zip(self._response_codes, each_pixel(fast.o.code, self.pixels_per_clock), strict=True):
            harris_code = delayed(m, block.o.code, harris_wait)
            fast_code = delayed(m, score, fast_wait)
            chosen_codes.append(Mux(self.i_fast, fast_code, harris_code))
        # Not taken from a detector: the one that rests has no valid beats.
        carry_scan(m, columns.o, suppression.i, self._response_cycles)
        codes = each_pixel(suppression.i.code, self.pixels_per_clock)
        m.d.comb += [code.eq(chosen) for code, chosen in zip(codes, chosen_codes, strict=True)]
        return m
