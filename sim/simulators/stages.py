"""Finds the stage where hardware and golden model differ, with a build of the front end that outputs its stages."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from amaranth.hdl import Cat, ClockDomain, ClockSignal, Const, Module, ResetSignal, Signal, Value, signed
from amaranth.lib.wiring import In, Out

from golden_model.arrays import Pixels, Records
from golden_model.config import Config, FrontEndConfig
from golden_model.front_end import trace
from hdl.axi.flat_ports import FlatTop, packet_pins, stream_pins
from hdl.build import Build
from hdl.front_end import FrontEnd
from hdl.pixel.corners import Stage
from hdl.settings import FRONT_END, frame_settings
from sim.backends.interface import Mismatch, Progress, silent
from sim.simulators.accelerator_designs import FEATURES, choose_build, strip_settings
from sim.simulators.design import Design, Ports
from sim.simulators.recording import Segment, flatten_frame
from sim.simulators.scoreboard import find_stage_mismatch
from sim.simulators.verilator import simulate

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


class FrontEndTop(FlatTop):
    """`hdl.front_end.FrontEnd` with AXI4-Stream ports, an input for each setting, and taps of its stages.

    Members
    -------
    s_axis_video_*, m_axis_features_* : AXI4-Stream
    tap_level<n>_<stage>_tdata : Out(64)
        `TAP_WORD`.
    tap_level<n>_<stage>_tvalid : Out(1)
    """

    def __init__(self, build: Build, *, taps: Sequence[Tap] = ()) -> None:
        self._front_end = inner = FrontEnd(build)
        self._reset_n = Signal(name="reset_n")
        video = inner.i_video.payload
        stages = {tap.port: inner.levels[tap.level].stages[tap.stage] for tap in taps}
        super().__init__(
            {
                "aclk": (In(1), ClockSignal()),
                "aresetn": (In(1), self._reset_n),
                **{name: (In(bits), inner.settings[name]) for name, bits in SETTINGS.items()},
                **stream_pins("s_axis_video", inner.i_video, In, tdata=video.data, tuser=video.first),
                **packet_pins("m_axis_features", inner.o_features),
                **{f"{port}_tdata": (Out(64), _tap_word(stage)) for port, stage in stages.items()},
                **{f"{port}_tvalid": (Out(1), stage.beats[0].valid) for port, stage in stages.items()},
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Connect ports by name."""
        m = Module()
        m.domains.sync = ClockDomain()
        m.submodules.front_end = self._front_end
        m.d.comb += ResetSignal().eq(~self._reset_n)
        self.connect_pins(m)
        return m


def _tap_word(stage: Stage) -> Value:
    (beat,) = stage.beats
    parts = ((beat[stage.field], 32), (beat.x - stage.lag_px, 16), (beat.y - stage.lag_px, 16))
    # The sum extends the sign: `Cat` alone would join the bits as they are.
    return Cat((Value.cast(value) + Const(0, signed(bits)))[:bits] for value, bits in parts)


def design_front_end(build: Build, *, taps: tuple[Tap, ...] = ()) -> Design:
    """The front end alone, with ``taps`` that show stages."""
    build = strip_settings(build)
    return Design(
        "the front end",
        Ports(outputs=(FEATURES,), settings=SETTINGS, taps=tuple(tap.port for tap in taps)),
        lambda: FrontEndTop(build, taps=taps),
        f"{build} {taps}",
    )


def locate_mismatch(
    image: Pixels, config: FrontEndConfig, *, frame: int = 0, progress: Progress = silent
) -> Mismatch | None:
    """The first stage of the front end, level by level, whose plane differs from `golden_model.front_end.trace`.

    None if all planes are equal: then the difference arises after the corner candidates. See
    `sim.backends.interface.Backend.locate`.
    """
    height_px, width_px = image.shape[:2]
    data, flags = flatten_frame(image)
    values = frame_settings(config, width_px, height_px, gray_input=image.ndim == 2)
    segment = Segment(data, flags, packets=1, cycle_limit=4 * data.size, settings=values)
    golden = trace(image, config)
    taps = tuple(Tap(number, name) for number, level in enumerate(golden.levels) for name in level)
    design = design_front_end(choose_build(Config(front_end=config), [image]), taps=taps)
    (recording,) = simulate(design, [segment], progress=progress)
    planes: list[dict[str, np.ma.MaskedArray]] = [{} for _ in golden.levels]
    for tap in taps:
        words = recording.taps[tap.port].view(TAP_WORD)
        planes[tap.level][tap.stage] = _place_values(words, (height_px >> tap.level, width_px >> tap.level))
    return find_stage_mismatch(golden, planes, frame=frame)


def _place_values(words: Records, shape: tuple[int, int]) -> np.ma.MaskedArray:
    """The values at their pixels; the other pixels are masked, since the hardware sent no value for them."""
    plane: np.ma.MaskedArray = np.ma.MaskedArray(np.zeros(shape, np.int64), mask=True)
    x, y = words["x"], words["y"]
    # Stages lag behind the scan, so their first and last beats lie outside the frame.
    inside = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
    plane[y[inside], x[inside]] = words["value"][inside]
    return plane
