"""The front end alone with flat ports, to measure it and to observe its stages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from amaranth.hdl import Cat, ClockDomain, ClockSignal, Module, ResetSignal, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.front_end import FrontEnd
from hdl.settings import FRONT_END
from hdl.streams import WORD

SETTINGS = {setting.name: setting.bits for setting in FRONT_END}
"""The run-time settings and their widths, as the names of input ports."""


class Tap(NamedTuple):
    """A stage to observe: its level, and its name in `golden_model.front_end.trace`."""

    level: int
    stage: str

    @property
    def port(self) -> str:
        """Prefix of the tap's ports."""
        return f"tap_level{self.level}_{self.stage}"


TAP_WORD = np.dtype([("value", "<i4"), ("x", "<i2"), ("y", "<i2")])
"""A tap's word: the value of a stage, and the pixel it describes, in pixels of the level."""


class FrontEndTop(wiring.Component):
    """`hdl.front_end.FrontEnd` with AXI4-Stream ports, an input for each setting, and taps of its stages.

    Members
    -------
    s_axis_video_*, m_axis_features_* : AXI4-Stream
    tap_level<n>_<stage>_tdata : Out(64)
        `TAP_WORD`.
    tap_level<n>_<stage>_tvalid : Out(1)
    """

    if TYPE_CHECKING:
        # The ports follow from tables; a type checker cannot know their names.
        def __getattr__(self, name: str) -> Signal: ...

    def __init__(self, front_end: FrontEnd, *, taps: Sequence[Tap] = ()):
        self._front_end = front_end
        self._stages = {tap: front_end.levels[tap.level].stages[tap.stage] for tap in taps}
        super().__init__(
            {
                "aclk": In(1),
                "aresetn": In(1),
                **{name: In(bits) for name, bits in SETTINGS.items()},
                "s_axis_video_tdata": In(len(front_end.i_video.payload.data)),
                **{f"s_axis_video_{name}": In(1) for name in ("tuser", "tlast", "tvalid")},
                "s_axis_video_tready": Out(1),
                "m_axis_features_tdata": Out(WORD),
                "m_axis_features_tlast": Out(1),
                "m_axis_features_tvalid": Out(1),
                "m_axis_features_tready": In(1),
                **{f"{tap.port}_tdata": Out(64) for tap in self._stages},
                **{f"{tap.port}_tvalid": Out(1) for tap in self._stages},
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Connect ports by name."""
        m = Module()
        m.domains.sync = ClockDomain()
        m.submodules.front_end = inner = self._front_end
        video, words = inner.i_video, inner.o_features
        m.d.comb += [
            ClockSignal().eq(self.aclk),
            ResetSignal().eq(~self.aresetn),
            *(inner.settings[name].eq(getattr(self, name)) for name in SETTINGS),
            video.valid.eq(self.s_axis_video_tvalid),
            video.payload.data.eq(self.s_axis_video_tdata),
            video.payload.first.eq(self.s_axis_video_tuser),
            video.payload.last.eq(self.s_axis_video_tlast),
            self.s_axis_video_tready.eq(video.ready),
            self.m_axis_features_tvalid.eq(words.valid),
            self.m_axis_features_tdata.eq(words.payload.data),
            self.m_axis_features_tlast.eq(words.payload.last),
            words.ready.eq(self.m_axis_features_tready),
        ]
        for tap, stage in self._stages.items():
            value, x, y = Signal(signed(32)), Signal(signed(16)), Signal(signed(16))
            (beat,) = stage.beats
            m.d.comb += [
                # Assigned to signals first, which extends the sign: `Cat` alone would join the bits as they are.
                value.eq(beat[stage.field]),
                x.eq(beat.x - stage.lag_px),
                y.eq(beat.y - stage.lag_px),
                getattr(self, f"{tap.port}_tvalid").eq(beat.valid),
                getattr(self, f"{tap.port}_tdata").eq(Cat(value, x, y)),
            ]
        return m
