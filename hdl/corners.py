"""From gray columns to corner candidates: the chain of blocks behind a level's gray lines."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

from amaranth import Module, Signal
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import FrontEndConfig
from golden_model.formats import RESPONSE_CODE
from hdl.harris import RawResponse, ResponseCode, StructureTensor
from hdl.nms import NEIGHBOURHOOD, Suppression
from hdl.smooth import Binomial
from hdl.sobel import Sobel
from hdl.streams import beat
from hdl.window import LineBuffer


class Stage(NamedTuple):
    """A plane of `golden_model.front_end.trace` in the hardware: a field of a beat, and how far it lags."""

    beat: data.View
    field: str
    lag_px: int


class Corners(wiring.Component):
    """Smoothing, gradients, tensor, response, threshold, suppression.

    Parameters
    ----------
    config : FrontEndConfig
    width_px : int
        Largest width of a line.

    Members
    -------
    i : In(beat(column))
        3 gray pixels, the newest line first.
    i_threshold_code : In(15)
    o : Out(beat(code, left, right, up, down))
        Corners, not kept off the border.

    Attributes
    ----------
    lag_px : int
    latency_cycles : int

    Raises
    ------
    ValueError
        For a detector that is not built.
    """

    i: data.View
    i_threshold_code: Signal
    o: data.View

    def __init__(self, *, config: FrontEndConfig, width_px: int) -> None:
        if config.detector != "harris":
            raise ValueError(f"detector is {config.detector!r}; the hardware has: harris")
        self._chain = {}
        if config.smoothed_gradients:
            self._chain["smooth"] = Binomial(window_px=3)
            self._chain["smoothed_lines"] = LineBuffer(shape=8, lines=2, width_px=width_px)
        self._chain |= {
            "sobel": Sobel(),
            "tensor": StructureTensor(window_px=config.tensor_window_px, width_px=width_px),
            "raw_response": RawResponse(k_numerator=config.harris_k_numerator, k_shift=config.harris_k_shift),
            "response_code": ResponseCode(),
            "suppression": Suppression(radius_px=config.suppression_radius_px, width_px=width_px),
        }
        self.response_lag_px = config.response_support_px
        self.lag_px = self.response_lag_px + config.suppression_radius_px
        self.latency_cycles = sum(block.latency_cycles for block in self._chain.values())
        super().__init__(
            {
                "i": In(beat(column=data.ArrayLayout(8, 3))),
                "i_threshold_code": In(RESPONSE_CODE.bits),
                "o": Out(beat(**NEIGHBOURHOOD)),
            }
        )

    @property
    def stages(self) -> dict[str, Stage]:
        """The planes on the way, by their golden names."""
        gradient_lag_px = self.response_lag_px - self._chain["tensor"].lag_px
        fields = {
            "smoothed": ("smooth", "pixel", gradient_lag_px - 1),
            "gradient_x": ("sobel", "gradient_x", gradient_lag_px),
            "gradient_y": ("sobel", "gradient_y", gradient_lag_px),
            **{f"tensor_{name}": ("tensor", name, self.response_lag_px) for name in "abc"},
            "raw_response": ("raw_response", "raw", self.response_lag_px),
            "response_code": ("response_code", "code", self.response_lag_px),
        }
        return {
            name: Stage(self._chain[block].o, field, lag_px)
            for name, (block, field, lag_px) in fields.items()
            if block in self._chain
        }

    def elaborate(self, platform: object) -> Module:
        """Chain the blocks."""
        m = Module()
        for name, block in self._chain.items():
            m.submodules[name] = block
        blocks = list(self._chain.values())
        m.d.comb += blocks[0].i.eq(self.i)
        m.d.comb += [after.i.eq(before.o) for before, after in pairwise(blocks)]
        m.d.comb += [
            self._chain["response_code"].i_threshold_code.eq(self.i_threshold_code),
            self.o.eq(blocks[-1].o),
        ]
        return m
