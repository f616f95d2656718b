"""Mosaics that grow: frames of a rendered flight as they come, from a folder being filled, from videos."""

import itertools
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from golden_model.config import preset_config
from sim.scene import Flight
from skymosaic import mosaic
from skymosaic.cli.live import live as live_command
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.imagery.key_frames import flight_sources
from skymosaic.imagery.live_frames import read_live_frames
from skymosaic.imagery.video import write_video
from skymosaic.mosaicking.live.mosaic import LiveMosaic
from skymosaic.mosaicking.live.pace import Pace
from skymosaic.mosaicking.live.run import grow
from skymosaic.mosaicking.options import LiveOptions
from skymosaic.mosaicking.run import MosaicRun
from tests.conftest import Run
from tests.made import write_pictures
from tests.skymosaic.mosaicking.live.conftest import pair_errors_px
from tests.system.command_line import skymosaic
from tests.system.conftest import SIZE

CONFIG = preset_config("aerial")


@pytest.fixture(scope="module")
def frames(flight: Flight) -> list[np.ndarray]:
    return list(flight.images)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory, frames: list[np.ndarray]) -> Path:
    """A pan over the first two photographs side by side."""
    path = tmp_path_factory.mktemp("video") / "pan.mp4"
    wide = mosaic(frames[:3]).image
    with write_video(path, Fraction(25)) as write:
        for step in range(0, wide.shape[0] - 240, 20):
            write(np.ascontiguousarray(wide[step : step + 240, 80:400]))
    return path


class FolderClock:
    """Time for whoever watches a folder: it passes, and files arrive, only while they sleep."""

    def __init__(self, arriving: Iterator[Path]) -> None:
        self._arriving = arriving
        self._now_ns = 0

    def monotonic(self) -> float:
        return self._now_ns / 1e9

    def time_ns(self) -> int:
        return self._now_ns

    def sleep(self, seconds: float) -> None:
        self._now_ns += int(seconds * 1e9)
        for path in itertools.islice(self._arriving, 1):
            os.utime(path, ns=(self._now_ns, self._now_ns))


def test_a_folder_is_watched_until_no_more_frames_arrive(
    frames: list[np.ndarray], flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Photographs arrive one by one, each in two halves, the last one damaged."""
    encoded = [cv2.imencode(".png", frame)[1].tobytes() for frame in frames[:4]]

    def arriving() -> Iterator[Path]:
        for index, data in enumerate(encoded):
            path = tmp_path / f"{index}.png"
            for part in (data[: len(data) // 2], data):
                path.write_bytes(part)
                yield path
        (tmp_path / "9.png").write_bytes(encoded[0][:3000])
        yield tmp_path / "9.png"

    monkeypatch.setattr("skymosaic.imagery.live_frames.time", FolderClock(arriving()))
    told: list[str] = []
    pace, preview = Pace(CONFIG, "rtl"), tmp_path / "preview.jpg"
    live = LiveMosaic(config=CONFIG, on_frame=pace.add)
    # The preview lies among the photographs and is none of them.
    arriving_frames = read_live_frames(str(tmp_path), idle_seconds=2.0, tell=told.append, made=[preview])
    grow(live, pace.watch(arriving_frames), preview, told.append)
    assert preview.exists()
    assert len(live.transforms) == 4
    assert pair_errors_px(live.transforms, flight).max() < 1.0
    assert any("9.png" in line and "truncated" in line for line in told)
    # 480x360 pixels take longer than matching their features.
    assert pace.numbers["accelerator"]["clocks_per_frame"] == SIZE[0] * SIZE[1]
    assert 0 < pace.numbers["accelerator"]["latency_ms"] < 1
    assert [pace.numbers[count] for count in ("seen", "used", "dropped")] == [4, 4, 0]


def test_a_frame_that_comes_under_the_name_of_the_mosaic_stays(
    frames: list[np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def arriving() -> Iterator[Path]:
        for name, frame in zip(("0.png", "1.png", "m.png"), frames, strict=False):
            cv2.imwrite(str(tmp_path / name), frame)
            yield tmp_path / name

    monkeypatch.setattr("skymosaic.imagery.live_frames.time", FolderClock(arriving()))
    live_command(
        source=str(tmp_path), output=tmp_path / "m.png", overwrite=True, idle_seconds=2.0, options=LiveOptions()
    )
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "m.png")), frames[2])
    assert cv2.imread(str(tmp_path / "m_2.png")).shape[0] > SIZE[1]
    assert "m.png: came as a frame meanwhile, and stays; the mosaic is" in capsys.readouterr().err


def test_every_frame_is_a_line_of_json_and_named_as_in_a_mosaic(video: Path, tmp_path: Path) -> None:
    result = skymosaic("live", video, "-o", "m.tif", "--json", cwd=tmp_path)
    *frames, whole = map(json.loads, result.stdout.splitlines())
    assert whole["frames"] == len(frames)
    assert all(frame["placed"] and np.shape(frame["pose"]) == (3, 3) for frame in frames)
    assert [frame["time"] for frame in frames] == sorted({frame["time"] for frame in frames})
    assert whole["seconds"]["other"] < 0.5 * whole["seconds"]["total"]
    assert "m.tif has no place on the map" in whole["warnings"][0]
    assert (tmp_path / "m.preview.jpg").exists()
    with flight_sources([video]) as sources:
        assert [frame["name"] for frame in frames] == [source.name for source in sources]
    with pytest.raises(RegistrationError, match="mosaic with `positions` or `control_points`, gives it one; nothing"):
        live_command(source=str(video), output=tmp_path / "n.tif", require_map=True, options=LiveOptions())
    assert not list(tmp_path.glob("n.*"))


def test_a_second_end_leaves_the_preview(
    frames: list[np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_pictures(tmp_path, frames[:2])
    monkeypatch.setattr(MosaicRun, "write", Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(InputError, match=r"m\.png: stopped again, so it is not composed; its preview stays"):
        live_command(source=str(tmp_path), output=tmp_path / "m.png", idle_seconds=0.5, options=LiveOptions())
    assert (tmp_path / "m.preview.jpg").exists()


@pytest.mark.parametrize(("damaged", "why"), [(False, "none came"), (True, "1 left out, the first: flight/0.jpg: ")])
def test_a_source_without_a_usable_frame_is_named(run: Run, damaged: bool, why: str) -> None:
    (folder := Path("flight")).mkdir()
    if damaged:
        (folder / "0.jpg").write_bytes(b"cut off")
    status, _, errors = run("live", "flight", "-o", "m.png", "--idle-seconds", "0.5")
    assert (status, f"error: flight: no frame could be used; {why}" in errors) == (3, True), errors
    assert not list(Path().glob("m.*"))


def start_live(tmp_path: Path, frames: list[np.ndarray], *before: str) -> subprocess.Popen[str]:
    """A live mosaic of a folder that never ends by itself, which has placed its second frame."""
    write_pictures(tmp_path, frames[:2])
    command = [*before, "-m", "skymosaic", "live", str(tmp_path), "-o", str(tmp_path / "grown.jpg")]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    process = subprocess.Popen([sys.executable, *command], stderr=subprocess.PIPE, text=True, env=environment)
    assert process.stderr is not None
    while "ties to" not in (line := process.stderr.readline()):
        assert line, "it ended before the second frame"
    return process


HANG_UP = """
import os, pty, sys, time
child, terminal = pty.fork()
if child == 0:
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
shown = b""
while b"ties to" not in shown:
    shown += os.read(terminal, 1000)
os.close(terminal)
print("0 ties to 1", file=sys.stderr, flush=True)
os.waitpid(child, 0)
"""


@pytest.mark.parametrize("end", ["SIGTERM", "closed terminal"])
def test_the_mosaic_is_written_when_the_system_ends_it(tmp_path: Path, frames: list[np.ndarray], end: str) -> None:
    process = start_live(tmp_path, frames, *(["-c", HANG_UP] if end == "closed terminal" else []))
    if end != "closed terminal":
        process.terminate()
    errors = process.communicate(timeout=60)[1]
    assert process.returncode == 0, errors
    assert min(cv2.imread(str(tmp_path / "grown.jpg")).shape[:2]) > SIZE[1] // 2
    assert end == "closed terminal" or "stopped; writing the mosaic" in errors
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".skymosaic-") and path.is_dir()]
