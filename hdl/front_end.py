"""The front end: takes a video stream, gives feature records and one status per frame."""

from amaranth import Cat, Module, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MIN_FRAME_PX
from hdl.axi.video_input import VideoInput, video_payload
from hdl.build import Build
from hdl.frame_admission import FrameAdmission
from hdl.level import Level
from hdl.level_merge import LevelMerge
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.skid_buffer import SkidBuffer
from hdl.lib.views import view_signal
from hdl.pixel.gray import Gray
from hdl.pixel.half import Half
from hdl.pixel.threshold import AdaptiveThreshold
from hdl.settings import FRONT_END
from hdl.streams import FRONT_END_SETTINGS, WordPayload


class FrontEnd(Component):
    """Features of one or two levels, at one or two pixels per clock; of a build, matcher and shell play no part.

    Nothing stalls inside: pixels wait only at frame admission. They wait in three cases: a cell row would end before
    the previous one has left, a frame would end before the last frame's status has left, or the settings change. No
    matter how long the output stalls, nothing is lost or duplicated.
    """

    i_video: stream.Interface
    """Stream of `hdl.axi.video_input.video_payload`."""
    settings: In(FRONT_END_SETTINGS)
    """`hdl.streams.FRONT_END_SETTINGS`, sampled where a frame may start. A change takes effect once the previous frame
    has left completely. A frame whose settings are out of range, or beyond what was built, is refused
    (`Cause.INVALID_SETTINGS`)."""
    o_frame_starts: Out(1)
    """A frame has been admitted."""
    o_frame_ends: Out(1)
    """A frame has ended. A frame without pixels ends without a start."""
    o_features: Out(stream.Signature(WordPayload))
    """Stream of `hdl.streams.WordPayload`: Feature records in the golden order of emission, then the frame's
    FrameStatus."""

    levels: tuple[Level, ...]
    closing_clocks: int
    """A frame that was cut off delays the next one by the rest of its line and this, at most."""

    def __init__(self, build: Build) -> None:
        self.build = build
        self.config = config = build.config.front_end
        self._video_input = VideoInput(video_bits=build.video_bits)
        self.pixels_per_clock = self._video_input.pixels_per_clock
        self.levels = tuple(
            Level(config=config, level=n, width_px=build.max_width_px >> n, pixels_per_clock=self.pixels_per_clock)
            for n in range(config.levels)
        )
        self._closing_lines = max(level.closing_lines for level in self.levels)
        # `FrameAdmission` begins at even coordinates, one line and one column early in a frame of odd sides.
        self.closing_clocks = (self._closing_lines + 1) * (MIN_FRAME_PX + 1)
        super().__init__(i_video=In(stream.Signature(video_payload(build.video_bits))))

    def elaborate(self, platform: object) -> Module:
        """Admission, gray, levels and merge; settings and threshold, which change only between frames."""
        m = Module()
        # Admission decides late in the clock; its ready must not reach the port in the same one.
        m.submodules.skid_buffer = skid_buffer = SkidBuffer(shape=self.i_video.payload.shape())
        m.submodules.video_input = video_input = self._video_input
        m.submodules.admission = admission = FrameAdmission(
            closing_lines=self._closing_lines, pixels_per_clock=self.pixels_per_clock
        )
        m.submodules.gray = gray = Gray(pixels_per_clock=self.pixels_per_clock)
        m.submodules.merge = merge = LevelMerge(
            record=self.config.pattern.record, levels=self.config.levels, max_features=self.config.max_features
        )
        wiring.connect(m, wiring.flipped(self.i_video), skid_buffer.i)
        wiring.connect(m, skid_buffer.o, video_input.i)
        wiring.connect(m, video_input.o, admission.i)
        wiring.connect(m, merge.o, wiring.flipped(self.o_features))
        # `o_end` closes the gap of one clock between a running frame and a pending status.
        under_way = admission.o_running | admission.o_end | merge.o_pending
        active, load, may_start = self._settings(m, under_way)
        threshold_code = self._threshold(m, admission, active, load)
        # Registered, to keep the paths from the levels to the admission short; `INGRESS_CYCLES` allows for it.
        m.d.sync += admission.i_hold.eq(Cat(level.o_hold for level in self.levels).any())
        m.d.comb += [
            video_input.i_memory_mode.eq(active.memory_mode),
            video_input.i_gray_input.eq(active.gray_input),
            video_input.i_frame_ends.eq(admission.o_frame_ends),
            self.o_frame_starts.eq(admission.o_start),
            self.o_frame_ends.eq(admission.o_end),
            admission.i_memory_mode.eq(active.memory_mode),
            admission.i_width_px.eq(active.width_px),
            admission.i_height_px.eq(active.height_px),
            admission.i_acceptable.eq(self._acceptable(m, active)),
            admission.i_may_start.eq(may_start),
            # The merge holds one status at a time.
            admission.i_may_end.eq(~merge.o_pending),
            gray.i.eq(admission.o),
            gray.i_gray_input.eq(active.gray_input),
            merge.i_settings.eq(active),
            merge.i_starts.eq(admission.o_start),
            merge.i_ends.eq(admission.o_end),
            merge.i_causes.eq(admission.o_causes),
            merge.i_threshold_code.eq(threshold_code),
        ]
        for n, (level, pixels) in enumerate(zip(self.levels, self._pyramid(m, gray.o, active), strict=True)):
            m.submodules[f"level{n}"] = level
            wiring.connect(m, level.o, merge.i_levels[n])
            m.d.comb += [level.i.eq(pixels), level.i_settings.eq(active), level.i_threshold_code.eq(threshold_code)]
        return m

    def _pyramid(self, m: Module, gray: data.View, active: data.View) -> list[data.View]:
        if self.config.levels == 1:
            return [gray]
        m.submodules.half = half = Half(width_px=self.build.max_width_px, pixels_per_clock=self.pixels_per_clock)
        m.d.comb += half.i.eq(gray)
        if self.pixels_per_clock == 2:
            # The right pixel of an odd line's last beat is beyond the line.
            m.d.comb += half.i.valid.eq(gray.valid & (gray.x[1:] != active.width_px[1:]))
        return [gray, half.o]

    def _settings(self, m: Module, under_way: Value) -> tuple[data.View, Value, Value]:
        """Return the settings in use, whether they are replaced in this clock, and whether a frame may start.

        A frame may start only if the settings in use equal the requested ones, now and in the clock before:
        comparison and replacement are both registered, and each takes effect a clock later.
        """
        active = view_signal(FRONT_END_SETTINGS)
        changing = Signal()
        load = Signal()
        settled = Signal()
        m.d.sync += [
            changing.eq(active.as_value() != self.settings.as_value()),
            settled.eq(~changing),
            load.eq(changing & ~under_way),
        ]
        with m.If(load):
            m.d.sync += active.eq(self.settings)
        return active, load, settled & ~changing

    def _acceptable(self, m: Module, active: data.View) -> Value:
        """Tell whether every setting in use is in its range and was built."""
        built_px = {"width_px": self.build.max_width_px, "height_px": self.build.max_height_px}
        checks = []
        # A bound that the width of the setting already guarantees needs no comparison.
        for setting in FRONT_END:
            value, maximum = active[setting.name], built_px.get(setting.name, setting.values[-1])
            if setting.values[0]:
                checks.append(value >= setting.values[0])
            if maximum < (1 << setting.bits) - 1:
                checks.append(value <= maximum)
        return delayed(m, Cat(checks).all(), 1)

    def _threshold(self, m: Module, admission: FrameAdmission, active: data.View, load: Value) -> Value:
        m.submodules.threshold = threshold = AdaptiveThreshold(max_features=self.config.max_features)
        m.d.comb += [
            threshold.i_detector.eq(active.detector),
            threshold.i_load.eq(load),
            threshold.i_code.eq(self.settings.threshold_code),
            # Both levels may add a feature in one clock.
            threshold.i_added.eq(sum(level.o_added for level in self.levels)),
            threshold.i_frame_ends.eq(admission.o_end),
            # A bad frame says nothing about the number of features that the scene has.
            threshold.i_adapt.eq(active.adaptive & ~admission.o_causes.any()),
            threshold.i_target.eq(active.target_features),
        ]
        code: Value = threshold.o_code
        return code
