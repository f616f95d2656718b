# amaranth: UnusedElaboratable=no
"""The front end equals the golden model on whole frames, good and bad; compiled, since a frame takes many clocks.

It stands for tests of `level_merge`: order, indices and status. `tests/formal` proves that records leave whole,
`test_accelerator` predicts a frame's clocks.
"""

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import MIN_FRAME_PX, PRESETS, Config, FrontEndConfig
from golden_model.formats import decode_response
from golden_model.front_end import FrameFeatures, extract
from golden_model.pixel.threshold import next_code
from golden_model.records import FRAME_STATUS, WORD_BYTES, Cause
from hdl.build import Build
from hdl.front_end import FrontEnd
from hdl.level import Level
from hdl.pixel.gray import Gray
from hdl.pixel.threshold import AdaptiveThreshold
from hdl.selection.cell_ranking import CellRanking
from hdl.selection.level_scan import LevelScan
from hdl.settings import frame_settings
from sim.scene import make_pair
from sim.simulators import verilator
from sim.simulators.accelerator_designs import FEATURES
from sim.simulators.compiled import Bench
from sim.simulators.recording import NO_PAUSES, Pauses, Segment, flatten_frame
from sim.simulators.stages import design_front_end

AERIAL = PRESETS["aerial"].front_end
FAST = dataclasses.replace(AERIAL, detector="fast", threshold=10)
# Without selection a frame may have more corners than fit; this many do.
THESIS = dataclasses.replace(PRESETS["thesis"].front_end, threshold=200_000)
SMALL_PX = (160, 120)
PAUSES = Pauses(gaps=90, stalls=210, seed=8)


class FrontEndBench:
    """A compiled front end after its reset, compared with the golden model on the same frames.

    ``config`` of a call replaces the configuration by another one of the same build. ``pair_bits`` is the width of an
    input that takes two pixels per clock.
    """

    def __init__(self, bench: Bench, config: FrontEndConfig, pair_bits: int = 0) -> None:
        self.bench, self.config, self.pair_bits = bench, config, pair_bits
        self.pixels_per_clock = 2 if pair_bits else 1
        self.record = config.pattern.record
        self.frames = 0

    def flatten(self, frame: NDArray[np.uint8]) -> tuple[NDArray[np.uint64], NDArray[np.uint8]]:
        """The frame's beats: data and flags."""
        return flatten_frame(frame, pair_bits=self.pair_bits)

    def run(
        self,
        beats: list[Any],
        size_px: tuple[int, int],
        packets: int,
        *,
        config: FrontEndConfig | None = None,
        pauses: Pauses = NO_PAUSES,
        reset: bool = False,
        gray_input: bool = True,
        **settings: int,
    ) -> tuple[Any, ...]:
        """Stream beats; returns features and status of each packet, and the clocks of the admitted starts of frame."""
        settings = {**frame_settings(config or self.config, *size_px, gray_input=gray_input), **settings}
        data, flags = (np.concatenate(parts) for parts in zip(*beats, strict=True))
        limit = 4 * data.size + packets * 4 * self.config.max_features * self.record.record_bytes
        segment = Segment(data, flags, packets, limit, settings=settings, reset=reset)
        recording = self.bench.run(segment, pauses)
        self.frames = packets + (0 if reset else self.frames)
        return [self._split(words) for words in recording.outputs[FEATURES].packets], recording.starts

    def _split(self, words: Any) -> Any:
        status_words = self.record.record_bytes // WORD_BYTES
        status = words[-status_words:][: FRAME_STATUS.record_bytes // WORD_BYTES].view(FRAME_STATUS.dtype)[0]
        return words[:-status_words].view(self.record.dtype), status

    def check(
        self, frames: list[NDArray[np.uint8]], *, config: FrontEndConfig | None = None, **options: Any
    ) -> tuple[NDArray[np.uint64], NDArray[np.void]]:
        """Stream whole frames of one size and compare every field; returns the starts and all features."""
        config = config or self.config
        height_px, width_px = frames[0].shape[:2]
        first = 0 if options.get("reset") else self.frames
        beats = [self.flatten(frame) for frame in frames]
        gray_input = frames[0].ndim == 2
        packets, starts = self.run(
            beats, (width_px, height_px), len(frames), gray_input=gray_input, config=config, **options
        )
        for number, (frame, packet) in enumerate(zip(frames, packets, strict=True), start=first):
            assert_golden(packet, extract(frame, config, frame=number))
        return starts, np.concatenate([features for features, _ in packets])


def assert_golden(packet: tuple[NDArray[np.void], np.void], golden: FrameFeatures) -> None:
    features, status = packet
    if golden.status["good"]:
        np.testing.assert_array_equal(features, golden.features)
    for name in set(FRAME_STATUS.dtype.names or ()) - {"cycles"}:
        assert status[name] == golden.status[name], name


def assert_varied(features: NDArray[np.void]) -> None:
    assert np.count_nonzero(features["level"] == 0) >= 1000
    assert np.count_nonzero(features["level"] == 1) >= 100
    assert len(np.unique(features["sector"])) == 16


def compiled(config: FrontEndConfig, **build: Any) -> closing:
    design = design_front_end(Build(config=Config(front_end=config), **build))
    return contextlib.closing(Bench(verilator.build_library(design), design.ports))


@pytest.fixture(scope="module", params=[pytest.param(0, id="one", marks=pytest.mark.slow), pytest.param(48, id="two")])
def aerial(request: pytest.FixtureRequest) -> Iterator[FrontEndBench]:
    """One or two pixels per clock, up to 4K; fast tests of one are those of the whole accelerator."""
    pair_bits = request.param
    with compiled(AERIAL, max_width_px=3840, max_height_px=2160, video_bits=pair_bits or 32) as bench:
        yield FrontEndBench(bench, AERIAL, pair_bits)


@pytest.fixture(scope="module")
def scene() -> Callable[..., Any]:
    """``view(number, size_px)``: one of two rendered views at any size, with its own noise."""
    views = make_pair(seed=3).images

    def view(number: Any, size_px: Any) -> Any:
        resized = cv2.resize(views[number % len(views)], size_px)
        noise = np.random.default_rng(number).normal(0, 8, resized.shape)
        return np.clip(resized + noise, 0, 255).astype(np.uint8)

    return view


def gray(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(frame[..., 1])


def extremes(size_px: tuple[int, int]) -> list[NDArray[np.uint8]]:
    """Black, white, checkerboard, one hot pixel, noise."""
    y, x = np.indices(size_px[::-1])
    hot = (x == size_px[0] // 2) & (y == size_px[1] // 2)
    noise = np.random.default_rng(5).integers(0, 256, x.shape)
    return [plane.astype(np.uint8) for plane in (0 * x, 0 * x + 255, (x + y) % 2 * 255, hot * 255, noise)]


def test_whole_frames_are_equal_and_follow_without_a_bubble(aerial: FrontEndBench, scene: Callable[..., Any]) -> None:
    starts, features = aerial.check([scene(number, (256, 192)) for number in range(3)])
    np.testing.assert_array_equal(np.diff(starts)[1:], 256 * 192 // aerial.pixels_per_clock)
    for size_px in ((1920, 64), (64, 1080)):
        features = np.concatenate([features, aerial.check([scene(3, size_px)])[1]])
    assert_varied(features)


@pytest.mark.slow
@pytest.mark.parametrize("size_px", [(640, 480), (1920, 1080), (3840, 2160)], ids=str)
def test_large_frames_are_equal_and_follow_without_a_bubble(
    aerial: FrontEndBench, scene: Callable[..., Any], size_px: tuple[int, int]
) -> None:
    for config in (AERIAL, FAST):
        starts, features = aerial.check([scene(number, size_px) for number in range(3)], config=config)
        np.testing.assert_array_equal(np.diff(starts)[1:], size_px[0] * size_px[1] // aerial.pixels_per_clock)
        assert_varied(features)


@pytest.mark.parametrize(
    ("size_px", "pauses"),
    [
        *(((65, 67), pauses) for pauses in (NO_PAUSES, PAUSES)),
        ((64, 64), NO_PAUSES),
        ((193, 131), PAUSES),
        *(pytest.param((641, 479), pauses, marks=pytest.mark.slow) for pauses in (NO_PAUSES, PAUSES)),
    ],
)
def test_frames_of_any_size_and_content_equal_the_golden_model(
    aerial: FrontEndBench, scene: Callable[..., Any], size_px: tuple[int, int], pauses: Pauses
) -> None:
    frames = [gray(scene(0, size_px)), *extremes(size_px), gray(scene(1, size_px))]
    _, features = aerial.check(frames, pauses=pauses)
    assert features.size


def test_fast_is_a_setting_beside_harris(aerial: FrontEndBench, scene: Callable[..., Any]) -> None:
    """One build processes whole frames with FAST, then any size and content with FAST and Harris in turn."""
    size_px = (320, 240)
    starts, features = aerial.check([gray(scene(number, size_px)) for number in range(3)], config=FAST)
    np.testing.assert_array_equal(np.diff(starts)[1:], size_px[0] * size_px[1] // aerial.pixels_per_clock)
    assert_varied(features)
    for config, size_px, pauses in (
        (FAST, (64, 64), NO_PAUSES),
        (AERIAL, (64, 64), NO_PAUSES),
        (FAST, (65, 67), PAUSES),
        (AERIAL, (127, 85), PAUSES),
    ):
        frames = [gray(scene(4, size_px)), *extremes(size_px)]
        _, features = aerial.check(frames, config=config, pauses=pauses)
        assert features.size


@pytest.mark.usefixtures("unused_blocks")
@pytest.mark.parametrize(("config", "video_bits"), [(AERIAL, 32), (AERIAL, 48), (THESIS, 32)])
def test_the_last_features_of_the_smallest_frame_are_counted_before_it_ends(
    config: FrontEndConfig, video_bits: int
) -> None:
    dut = FrontEnd(Build(config=Config(front_end=config), max_width_px=64, max_height_px=64, video_bits=video_bits))
    gray = Gray(pixels_per_clock=dut.pixels_per_clock)
    counted = CellRanking.latency_cycles + AdaptiveThreshold.latency_cycles
    for level in dut.levels:
        # Level 1 ends with the second of two lines, and an odd last line is not its own.
        lines = level.closing_lines - 1 - 2 * level.level
        needed = gray.latency_cycles + level.latency_cycles + counted
        assert lines * MIN_FRAME_PX // dut.pixels_per_clock >= needed


@pytest.mark.usefixtures("unused_blocks")
def test_marks_that_come_after_their_corner_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LevelScan, "latency_cycles", 100)
    with pytest.raises(ValueError, match="marks of the scan take 100 clocks, but the path that they meet only 53"):
        Level(config=FrontEndConfig(), level=0, width_px=64)


@pytest.mark.slow
def test_the_thesis_preset_at_two_pixels_a_clock(scene: Any) -> None:
    """Without selection, features leave one after the other: FAST's may follow each other in every clock."""
    # Lines take half the clocks, so that one more is needed to end a frame.
    config = dataclasses.replace(THESIS, threshold=200_000, border_px=THESIS.border_px + 1)
    with compiled(config, video_bits=16) as opened:
        bench = FrontEndBench(opened, config, pair_bits=16)
        sparse = dataclasses.replace(config, detector="fast", threshold=40)
        for pauses in (NO_PAUSES, PAUSES):
            for each in (config, sparse):
                _, features = bench.check(
                    [gray(scene(number, (641, 479))) for number in range(2)], config=each, pauses=pauses
                )
                assert features.size > 200


BAD_FRAMES: dict[str, tuple[Callable[..., Any], Cause]] = {
    "short_line": (lambda beats, line: np.delete(beats, 5 * line + 7, axis=1), Cause.SHORT_LINE),
    "long_line": (
        lambda beats, line: np.insert(beats, 50 * line + 7, beats[:, 50 * line + 6], axis=1),
        Cause.LONG_LINE,
    ),
    "early_end": (lambda beats, line: beats[:, : 60 * line], Cause.EARLY_END),
    "one_beat": (lambda beats, line: beats[:, :1], Cause.EARLY_END),
    "missing_start": (lambda beats, line: beats[:, 1:], Cause.MISSING_START),
}
"""What becomes of a frame's beats, of which a line has ``line``."""


@pytest.mark.parametrize("pauses", [NO_PAUSES, PAUSES], ids=["free", "pauses"])
@pytest.mark.parametrize(("spoil", "cause"), BAD_FRAMES.values(), ids=BAD_FRAMES)
def test_a_bad_frame_says_why_and_the_next_ones_are_clean(
    aerial: FrontEndBench, scene: Callable[..., Any], spoil: Callable[..., Any], cause: Cause, pauses: Pauses
) -> None:
    frames = [gray(scene(number, SMALL_PX)) for number in range(3)]
    first = aerial.frames
    before, *after = (aerial.flatten(frame) for frame in frames)
    bad = spoil(np.stack(aerial.flatten(frames[1])), SMALL_PX[0] // aerial.pixels_per_clock)
    packets, _ = aerial.run([before, bad, *after], SMALL_PX, 4, pauses=pauses)
    _, status = packets.pop(1)
    assert (status["good"], status["causes"], status["features"], status["frame"]) == (0, cause, 0, first + 1)
    for packet, frame, number in zip(packets, frames, (first, first + 2, first + 3), strict=True):
        assert_golden(packet, extract(frame, AERIAL, frame=number))


@pytest.mark.parametrize("admitted", [1, 2500, SMALL_PX[0] * SMALL_PX[1] // 2 - 1])
def test_reset_in_mid_frame_leaves_nothing(aerial: FrontEndBench, scene: Callable[..., Any], admitted: int) -> None:
    broken_off = [part[:admitted] for part in aerial.flatten(gray(scene(0, SMALL_PX)))]
    aerial.run([broken_off], SMALL_PX, 0)
    aerial.check([gray(scene(number, SMALL_PX)) for number in (1, 2)], reset=True)


def test_too_many_features_make_a_bad_frame(aerial: FrontEndBench) -> None:
    noise = extremes((640, 480))[-1]
    number = aerial.frames
    ((features, status),), _ = aerial.run([aerial.flatten(noise)], (640, 480), 1, cell_log2=5, per_cell=8)
    assert (status["good"], status["causes"], status["features"]) == (0, Cause.TOO_MANY_FEATURES, 0)
    assert len(features) == AERIAL.max_features
    small = extremes(SMALL_PX)[-1]
    assert status["frame"] == number
    aerial.check([small])


@pytest.mark.parametrize("initial", [AERIAL, FAST], ids=["harris", "fast"])
def test_the_adaptive_threshold_follows_the_golden_model_without_a_bubble(
    aerial: FrontEndBench, scene: Callable[..., Any], initial: FrontEndConfig
) -> None:
    # Of FAST's corners in smaller frames, a row of cells has not left at two pixels per clock when the next one ends.
    size_px = (320, 240)
    frames = [gray(scene(number, size_px)) for number in range(8)]
    target, number = 160, aerial.frames
    code = frame_settings(initial, *size_px, gray_input=True)["threshold_code"]
    beats = [aerial.flatten(frame) for frame in frames]
    packets, starts = aerial.run(beats, size_px, len(frames), config=initial, adaptive=1, target_features=target)
    np.testing.assert_array_equal(np.diff(starts)[1:], size_px[0] * size_px[1] // aerial.pixels_per_clock)
    for n, (frame, packet) in enumerate(zip(frames, packets, strict=True)):
        config = dataclasses.replace(initial, threshold=int(decode_response(np.array(code))))
        assert_golden(packet, extract(frame, config, frame=number + n))
        code = next_code(code, len(packet[0]), target, initial.detector)
