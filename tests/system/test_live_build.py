"""The whole live build: camera, accelerator, memory and the reader of the rings; delivered frames equal the model."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from golden_model.config import PRESETS
from golden_model.front_end import extract
from hdl.export import driver_map
from hdl.settings import REQUESTED, matched_frame_settings
from sim.golden import matched
from sim.live import CameraTiming, LiveBench, MemoryRules
from sim.scene import pair as rendered_pair

LIVE = Path(__file__).parents[2] / "constraints" / "live"
SIZE_PX = (160, 120)
CONFIG = PRESETS["aerial"]
SLOTS = 3
SETTINGS = matched_frame_settings(CONFIG, *SIZE_PX, gray_input=True)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The exported reader, with the map of this build."""
    folder = tmp_path_factory.mktemp("live")
    text = driver_map(CONFIG, live=True, max_width_px=SIZE_PX[0], max_height_px=SIZE_PX[1], video_bits=8)
    (folder / "skymosaic_map.py").write_text(text)
    sys.path[:0] = [str(folder), str(LIVE)]
    yield importlib.import_module("skymosaic_live")
    del sys.path[:2]
    for name in ("skymosaic_map", "skymosaic_live"):
        del sys.modules[name]


def opened(reader: Any, **rules: int) -> tuple[LiveBench, Any]:
    camera = CameraTiming(line_blank=20, frame_blank=2000, jitter=9, steps=3, period=4)
    bench = LiveBench(CONFIG, SIZE_PX, length_bytes=1 << 21, camera=camera, rules=MemoryRules(**rules))
    settings = {name: SETTINGS[name] for name in (*REQUESTED, "gray_input")}
    return bench, reader.Live(bench, settings, slots=SLOTS)


def views(count: int) -> list[np.ndarray]:
    """Views of a scene that move."""
    scene = np.ascontiguousarray(rendered_pair(seed=9, size=(240, 140)).images[0][..., 1])
    return [scene[n % 8 : n % 8 + SIZE_PX[1], 5 * n : 5 * n + SIZE_PX[0]].copy() for n in range(count)]


def check(delivered: list[tuple[int, Any, Any]], frames: list[np.ndarray], counts: dict[str, int]) -> None:
    """Every delivered frame equals the golden model, and every other one is counted as dropped."""
    front_end = CONFIG.front_end.for_size(*SIZE_PX)
    golden = [extract(frames[number - 1], front_end, frame=n) for n, (number, *_) in enumerate(delivered)]
    results = matched(((each.features, each.status, None) for each in golden), CONFIG, "previous")
    for (_, features, matches), expected in zip(delivered, results, strict=True):
        np.testing.assert_array_equal(features, expected.features)
        np.testing.assert_array_equal(matches, expected.matches)
    assert counts["camera_frames"] == len(frames) == counts["dropped"] + len(delivered)
    assert counts["cut"] == 0


def test_a_host_that_pauses_loses_frames_that_are_reported(reader: Any) -> None:
    bench, live = opened(reader, waits=60, latency_clocks=60, seed=4)
    frames, delivered = views(12), []
    bench.show(frames)
    for number in range(12):
        if number == 2:
            bench.run(200_000)
        frame = live.next_frame(0.05)
        if frame is None:
            break
        assert frame.good
        delivered.append((frame.number, frame.features.copy(), frame.matches.copy()))
        assert np.shares_memory(frame.features, bench.memory)
        live.release()
    counts = live.counts()
    check(delivered, frames, counts)
    assert counts["dropped"] > 0
    assert sum(len(matches) for *_, matches in delivered) > 50
    assert (bench.violations, live.damaged) == (0, 0)
    bench.close()


def test_errors_of_the_memory_cost_packets_and_a_restart_mends_everything(reader: Any) -> None:
    bench, live = opened(reader, failures=12, seed=3)
    frames = views(6)
    bench.show(frames)
    seen = [frame.good for frame in iter(lambda: _taken(live), None)]
    counts = live.counts()
    assert counts["features_errors"] + counts["matches_errors"] == bench.errors > 0
    assert live.damaged > 0
    assert len(seen) + live.damaged + counts["dropped"] == len(frames)
    live.restart()
    bench.show(views(1))
    bench.run(60_000)
    assert bench.violations == 0
    assert live.counts()["camera_frames"] == len(frames) + 1
    bench.close()


def test_a_camera_that_breaks_frames_off_and_changes_size(reader: Any) -> None:
    """The frame behind a broken one is whole: closing the broken one does not cost another."""
    bench, live = opened(reader, seed=1)
    whole = views(5)
    bench.show([whole[0], whole[1][:50], whole[2], whole[3][:, :100], whole[4]])
    frames = [(frame.number, frame.good, len(frame.features)) for frame in iter(lambda: _taken(live), None)]
    assert [(number, good) for number, good, _ in frames] == [(1, True), (2, False), (3, True), (4, False), (5, True)]
    assert all(count > 50 for _, good, count in frames if good)
    assert live.counts()["cut"] == 2
    assert live.counts()["dropped"] == 0
    assert bench.violations == 0
    bench.close()


def _taken(live: Any) -> Any:
    frame = live.next_frame(0.05)
    if frame is not None:
        live.release()
    return frame
