"""The front end alone behind flat ports: to measure it, and to look at its stages."""

from __future__ import annotations

from amaranth.hdl import ClockDomain, ClockSignal, Module, ResetSignal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.front_end import FrontEnd
from hdl.streams import WORD, FrontEndSettings

SETTINGS = {name: field.width for name, field in FrontEndSettings.as_shape()}
"""The run-time settings and their widths, as the names of input ports."""


class FrontEndTop(wiring.Component):
    """`hdl.front_end.FrontEnd` with AXI4-Stream ports, one input for each setting, and taps of its stages.

    Parameters
    ----------
    front_end : FrontEnd
    taps : bool
        Whether every beat of every stage leaves, as ``tap_level<n>_<stage>``.

    Members
    -------
    s_axis_video_*, m_axis_features_* : AXI4-Stream
    tap_level<n>_<stage>_tdata : Out(64)
        The stage's value, sign-extended.
    tap_level<n>_<stage>_tvalid : Out(1)

    Attributes
    ----------
    stages : dict of str to Stage
        By tap.
    """

    def __init__(self, front_end: FrontEnd, *, taps: bool = False):
        self.front_end = front_end
        self.stages = {
            f"tap_level{number}_{name}": stage
            for number, level in enumerate(front_end.levels if taps else ())
            for name, stage in level.stages.items()
        }
        super().__init__(
            {
                "aclk": In(1),
                "aresetn": In(1),
                **{name: In(bits) for name, bits in SETTINGS.items()},
                **{f"s_axis_video_{name}": In(bits) for name, bits in _VIDEO.items()},
                "s_axis_video_tready": Out(1),
                "m_axis_features_tdata": Out(WORD),
                "m_axis_features_tlast": Out(1),
                "m_axis_features_tvalid": Out(1),
                "m_axis_features_tready": In(1),
                **{f"{tap}_tdata": Out(64) for tap in self.stages},
                **{f"{tap}_tvalid": Out(1) for tap in self.stages},
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Names only."""
        m = Module()
        m.domains.sync = ClockDomain()
        m.submodules.front_end = inner = self.front_end
        pixels, words = inner.i_pixels, inner.o_features
        m.d.comb += [
            ClockSignal().eq(self.aclk),
            ResetSignal().eq(~self.aresetn),
            *(inner.settings[name].eq(getattr(self, name)) for name in SETTINGS),
            pixels.valid.eq(self.s_axis_video_tvalid),
            pixels.payload.data.eq(self.s_axis_video_tdata),
            pixels.payload.first.eq(self.s_axis_video_tuser),
            pixels.payload.last.eq(self.s_axis_video_tlast),
            self.s_axis_video_tready.eq(pixels.ready),
            self.m_axis_features_tvalid.eq(words.valid),
            self.m_axis_features_tdata.eq(words.payload.data),
            self.m_axis_features_tlast.eq(words.payload.last),
            words.ready.eq(self.m_axis_features_tready),
        ]
        for tap, stage in self.stages.items():
            m.d.comb += [
                getattr(self, f"{tap}_tvalid").eq(stage.beat.valid),
                getattr(self, f"{tap}_tdata").eq(stage.beat[stage.field]),
            ]
        return m


_VIDEO = {"tdata": 24, "tuser": 1, "tlast": 1, "tvalid": 1}
