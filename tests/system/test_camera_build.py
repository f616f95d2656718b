"""The whole camera build: camera, accelerator, estimator, memory and reader; delivered frames equal the model."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from golden_model.config import PRESETS, Config, EstimatorConfig
from golden_model.front_end import extract
from hdl.build import BUILDS
from hdl.settings import REQUESTED, matched_frame_settings
from sim.backends.golden import add_matches
from sim.benches.camera import CameraBench, CameraTiming
from sim.benches.exported import host_programs
from sim.benches.memory import MemoryRules
from sim.scene import make_pair

SIZE_PX = (160, 120)
CONFIG = dataclasses.replace(PRESETS["aerial"], estimator=EstimatorConfig(passes=2, min_cells=3))
BUILD = dataclasses.replace(
    BUILDS["camera"], config=CONFIG, max_width_px=SIZE_PX[0], max_height_px=SIZE_PX[1], video_bits=8
)
SLOTS = 3
SETTINGS = matched_frame_settings(CONFIG, *SIZE_PX, gray_input=True)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def reader() -> Iterator[Any]:
    """The exported reader, with the map of this build."""
    with host_programs(BUILD) as load:
        yield load("skymosaic_rings")


def opened(reader: Any, **rules: int) -> tuple[CameraBench, Any]:
    camera = CameraTiming(line_blank=20, frame_blank=2000, jitter=9, steps=3, period=4)
    bench = CameraBench(BUILD, length_bytes=1 << 21, camera=camera, rules=MemoryRules(**rules))
    settings = {name: SETTINGS[name] for name in (*REQUESTED, "gray_input")} | vars(CONFIG.estimator)
    return bench, reader.RingReader(bench, settings, slots=SLOTS)


def views(count: int) -> list[np.ndarray]:
    """Views of a scene that move."""
    scene = np.ascontiguousarray(make_pair(seed=9, size=(240, 140)).images[0][..., 1])
    return [scene[n % 8 : n % 8 + SIZE_PX[1], 5 * n : 5 * n + SIZE_PX[0]].copy() for n in range(count)]


def check(
    delivered: list[tuple[int, Any, Any, Any]],
    frames: list[np.ndarray],
    counts: dict[str, int],
    config: Config = CONFIG,
) -> None:
    """Every delivered frame equals the golden model, and every other one is counted as dropped."""
    front_end = config.front_end.for_size(*SIZE_PX)
    golden = [extract(frames[number - 1], front_end, frame=n) for n, (number, *_) in enumerate(delivered)]
    results = add_matches(golden, config, "previous")
    for (_, features, matches, homography), expected in zip(delivered, results, strict=True):
        np.testing.assert_array_equal(features, expected.features)
        np.testing.assert_array_equal(matches, expected.matches)
        assert homography == expected.homography
    assert counts["camera_frames"] == len(frames) == counts["dropped"] + len(delivered)
    assert counts["cut"] == 0


def test_a_host_that_pauses_loses_frames_that_are_reported(reader: Any) -> None:
    bench, rings = opened(reader, waits=60, latency_clocks=60, seed=4)
    frames, delivered = views(12), []
    bench.show(*frames)
    for number in range(12):
        if number == 2:
            bench.run(200_000)
        frame = rings.next_frame(0.05)
        if frame is None:
            break
        assert frame.good
        delivered.append((frame.number, frame.features.copy(), frame.matches.copy(), frame.homography.copy()))
        assert np.shares_memory(frame.features, bench.memory)
        assert frame.clocks < frame.homography_clocks
        rings.release()
    counts = rings.counts()
    check(delivered, frames, counts)
    assert counts["dropped"] > 0
    assert sum(len(matches) for *_, matches, _ in delivered) > 50
    assert sum(homography["causes"] == 0 for *_, homography in delivered) > 3
    assert (bench.violations, rings.damaged, rings.registers.read("lost_homographies")) == (0, 0, 0)
    bench.close()


def test_errors_of_the_memory_cost_packets_and_a_restart_mends_everything(reader: Any) -> None:
    bench, rings = opened(reader, failures=12, seed=3)
    frames = views(6)
    bench.show(*frames)
    seen = [frame.good for frame in iter(lambda: _taken(rings), None)]
    counts = rings.counts()
    assert sum(counts[f"{ring}_errors"] for ring in BUILD.outputs) == bench.errors > 0
    assert rings.damaged > 0
    assert len(seen) + rings.damaged + counts["dropped"] == len(frames)
    rings.restart()
    bench.show(*views(1))
    bench.run(60_000)
    assert bench.violations == 0
    assert rings.counts()["camera_frames"] == len(frames) + 1
    bench.close()


def test_a_camera_that_breaks_frames_off_and_changes_size(reader: Any) -> None:
    """The frame behind a broken one is whole: closing the broken one does not cost another."""
    bench, rings = opened(reader, seed=1)
    whole = views(5)
    bench.show(whole[0], whole[1][:50], whole[2], whole[3][:, :100], whole[4])
    frames = [(frame.number, frame.good, len(frame.features)) for frame in iter(lambda: _taken(rings), None)]
    assert [(number, good) for number, good, _ in frames] == [(1, True), (2, False), (3, True), (4, False), (5, True)]
    assert all(count > 50 for _, good, count in frames if good)
    assert rings.counts()["cut"] == 2
    assert rings.counts()["dropped"] == 0
    assert bench.violations == 0
    bench.close()


def test_no_burst_is_open_when_a_clear_is_complete(reader: Any) -> None:
    """Whenever it is asked for, and however the memory waits: the reset that follows cuts nothing off."""
    bench, rings = opened(reader, waits=150, latency_clocks=300, seed=2)
    rng, frames, open_before = np.random.default_rng(3), views(3), 0
    for number in range(40):
        bench.show(*frames[:2])
        bench.run(int(rng.integers(50_000)))
        # Every other time within a burst.
        for _ in range(100_000 * (number % 2)):
            bench.run(1)
            if bench.open_bursts and rng.random() < 0.02:
                break
        open_before += bench.open_bursts > 0
        rings.close()
        assert bench.open_bursts == 0
        bench.run(int(rng.integers(3000)))
        assert bench.open_bursts == 0
        bench.reset()
        assert bench.violations == 0
        rings.restart()
    assert open_before > 10
    bench.show(*frames)
    found = [frame for frame in iter(lambda: _taken(rings), None) if frame.good][-1]
    expected = extract(frames[-1], CONFIG.front_end.for_size(*SIZE_PX), frame=int(found.status["frame"]))
    np.testing.assert_array_equal(found.features, expected.features)
    bench.close()


def _taken(rings: Any) -> Any:
    frame = rings.next_frame(0.05)
    if frame is not None:
        rings.release()
    return frame
