"""Mosaics that grow: frames of a rendered flight as they come, from a folder that fills, from videos."""

import itertools
import os
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from golden_model.config import preset_config
from sim.backends.interface import load_backend
from sim.scene import make_lawnmower
from skymosaic import mosaic
from skymosaic.cli.live import grow
from skymosaic.errors import InputError
from skymosaic.geometry.homography import apply, estimate
from skymosaic.imagery.live_frames import read_live_frames
from skymosaic.imagery.video import write_video
from skymosaic.live.mosaic import LiveMosaic
from skymosaic.live.pace import Pace
from tests.system.command_line import skymosaic

IMAGES, SIZE = 9, (480, 360)
CONFIG = preset_config("aerial")


@pytest.fixture(scope="module")
def flight():
    return make_lawnmower(seed=5, images=IMAGES, size=SIZE, forward_overlap=0.6, side_overlap=0.4)


@pytest.fixture(scope="module")
def frames(flight) -> list[np.ndarray]:
    return list(flight.images)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory, frames) -> Path:
    """A pan over the first two photographs side by side."""
    path = tmp_path_factory.mktemp("video") / "pan.mp4"
    wide = mosaic(frames[:3]).image
    with write_video(path, Fraction(25)) as write:
        for step in range(0, wide.shape[0] - 240, 8):
            write(np.ascontiguousarray(wide[step : step + 240, 80:400]))
    return path


def pair_errors_px(transforms, flight, least_overlap: float = 0.2) -> np.ndarray:
    """Mean error of every two frames that overlap, in pixels of the second, over what it shows of the first."""
    grid = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 9), np.linspace(0, SIZE[1] - 1, 7)), -1).reshape(-1, 2)
    errors = []
    for left, right in itertools.combinations(sorted(transforms), 2):
        if flight.overlap_between(left, right) >= least_overlap:
            true = apply(flight.homography_between(left, right), grid)
            found = apply(np.linalg.inv(transforms[right]) @ transforms[left], grid)
            common = ((true >= 0) & (true < SIZE)).all(axis=1)
            errors.append(np.linalg.norm(found - true, axis=1)[common].mean())
    return np.array(errors)


def test_every_frame_is_registered_on_arrival(flight, frames) -> None:
    live = LiveMosaic(CONFIG)
    updates = [live.add(frame) for frame in frames]
    assert [update.number for update in updates] == list(range(IMAGES))
    assert updates[0].placement is None
    assert all(update.placement for update in updates[1:])
    assert any(len(update.placement.neighbours) > 1 for update in updates[1:]), "no leg holds another"
    assert live.left_out == {}
    errors = pair_errors_px(live.transforms, flight)
    assert len(errors) > IMAGES
    assert errors.mean() < 0.7
    assert errors.max() < 2.0
    # What is painted is what the frames show there.
    for number in (0, IMAGES - 1):
        height, width = live.image.shape[:2]
        shown = cv2.warpPerspective(frames[number], live.transforms[number], (width, height))
        inside = (
            cv2.warpPerspective(np.full(SIZE[::-1], 255, np.uint8), live.transforms[number], (width, height)) == 255
        )
        assert np.median(np.abs(shown[inside].astype(int) - live.image[inside])) < 12


def test_given_features_make_the_same_mosaic_as_computed_ones(frames) -> None:
    results = load_backend("golden").run(frames[:4], CONFIG, reference="previous")
    given, computed = LiveMosaic(CONFIG), LiveMosaic(CONFIG)
    for frame, result in zip(frames, results, strict=False):
        given.add(frame, result.features)
        computed.add(frame)
    np.testing.assert_array_equal(given.image, computed.image)


def test_the_final_adjustment_brings_all_frames_within_a_third_of_a_pixel(flight, frames) -> None:
    """Without it, errors add up from frame to frame to more than a pixel."""
    live = LiveMosaic(CONFIG)
    for frame in frames:
        live.add(frame)
    live.finish()
    grid = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 4), np.linspace(0, SIZE[1] - 1, 4)), -1).reshape(-1, 2)
    found = np.concatenate([apply(live.transforms[index], grid) for index in range(IMAGES)])
    true = np.concatenate([apply(np.linalg.inv(flight.homographies[index]), grid) for index in range(IMAGES)])
    aligned = apply(estimate(found, true, model="similarity"), found)
    assert np.linalg.norm(aligned - true, axis=1).mean() < 0.3
    assert (live.image.any(axis=2)).mean() > 0.8


@pytest.mark.slow
def test_features_of_the_hardware_in_sequence_mode_make_a_live_mosaic(frames) -> None:
    """Compiles the accelerator the first time."""
    results = {name: load_backend(name).run(frames[:3], CONFIG, reference="previous") for name in ("golden", "rtl")}
    for wanted, got in zip(*results.values(), strict=True):
        np.testing.assert_array_equal(wanted.features, got.features)
        np.testing.assert_array_equal(wanted.matches, got.matches)
    live = LiveMosaic(CONFIG)
    updates = [live.add(frame, result.features) for frame, result in zip(frames, results["rtl"], strict=False)]
    assert all(update.placement for update in updates[1:])


def test_submaps_join_once_a_frame_overlaps_both(flight, frames) -> None:
    live = LiveMosaic(CONFIG)
    order = [0, 2, 1]  # 0 and 2 share next to nothing; 1 shows both
    submaps = [live.add(frames[index]).submaps for index in order]
    assert flight.overlap_between(0, 2) < 0.3
    assert submaps[0] == 1
    assert submaps[-1] == 1
    assert len(live.transforms) == 3
    placed = {order[number]: transform for number, transform in live.transforms.items()}
    assert pair_errors_px(placed, flight).max() < 1.0


def test_frames_without_overlap_and_flat_frames_are_left_out(frames) -> None:
    grain = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (360, 480, 3), dtype=np.uint8), (0, 0), 2)
    live = LiveMosaic(CONFIG)
    for frame in (*frames[:2], grain, np.full((360, 480, 3), 90, np.uint8)):
        live.add(frame)
    assert set(live.left_out) == {2, 3}
    assert "does not overlap the mosaic" in live.left_out[2]
    assert "too few features" in live.left_out[3]


def test_a_frame_beyond_the_canvas_limit_is_left_out_and_the_rest_stays(frames) -> None:
    live = LiveMosaic(CONFIG, canvas_limit_px=int(1.2 * SIZE[0] * SIZE[1]))
    live.add(frames[0])
    before = live.image.copy()
    assert "limit" in live.add(frames[1]).reason
    np.testing.assert_array_equal(live.image, before)


def test_the_layout_is_recomputed_without_a_frame_that_could_not_be_painted(frames) -> None:
    live = LiveMosaic(CONFIG, canvas_limit_px=int(1.6 * SIZE[0] * SIZE[1]))
    reasons = [live.add(frame).reason for frame in (frames[0], frames[1], frames[2], frames[0], frames[1])]
    assert ["limit" in reason for reason in reasons] == [False, False, True, False, False]
    live.finish()
    assert sorted(live.transforms) == [0, 1, 3, 4]


def test_a_scale_beyond_one_is_refused() -> None:
    with pytest.raises(InputError, match="scale is 2"):
        LiveMosaic(CONFIG, scale=2)


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


def test_a_folder_is_watched_until_no_more_frames_arrive(frames, flight, tmp_path: Path, monkeypatch) -> None:
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
    live, preview = LiveMosaic(CONFIG), tmp_path / "preview.jpg"
    # The preview lies among the photographs and is none of them.
    pace = Pace(CONFIG, "rtl")
    grow(live, read_live_frames(str(tmp_path), idle_seconds=2.0, tell=told.append, made=[preview]), preview, pace)
    assert preview.exists()
    assert len(live.transforms) == 4
    assert pair_errors_px(live.transforms, flight).max() < 1.0
    assert any("9.png" in line and "truncated" in line for line in told)
    # 480x360 pixels take longer than matching their features.
    assert pace.numbers["accelerator"]["clocks_per_frame"] == SIZE[0] * SIZE[1]
    assert 0 < pace.numbers["accelerator"]["latency_ms"] < 1
    assert (pace.numbers["seen"], pace.numbers["dropped"]) == (4, 0)


@pytest.mark.slow
def test_both_commands_make_the_same_mosaic_of_a_video(video: Path, tmp_path: Path) -> None:
    for command in (("live", video), ("mosaic", video, "--live")):
        result = skymosaic(*command, "-o", f"{command[0]}.png", cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert "0 left out" in result.stdout
    live, flagged = (cv2.imread(str(tmp_path / f"{name}.png")) for name in ("live", "mosaic"))
    np.testing.assert_array_equal(live, flagged)
    assert (tmp_path / "live.preview.jpg").exists()
    whole = skymosaic("mosaic", video, "-o", "whole.png", "--cache", "cache", cwd=tmp_path)
    assert whole.returncode == 0, whole.stderr
    assert "left out" not in whole.stderr
    assert cv2.imread(str(tmp_path / "whole.png")).shape[0] == pytest.approx(live.shape[0], rel=0.05)


def test_a_video_cut_off_in_a_frame_still_makes_a_mosaic(video: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.avi").write_bytes(b"")
    with write_video(tmp_path / "whole.mkv", Fraction(25)) as write:
        for frame in read_live_frames(str(video), idle_seconds=None, tell=lambda _line: None):
            for _ in range(3):
                write(frame.pixels)
    data = (tmp_path / "whole.mkv").read_bytes()
    (tmp_path / "cut.mkv").write_bytes(data[: int(0.9 * len(data))])
    result = skymosaic("mosaic", "cut.mkv", "-o", "m.png", "--cache", "cache", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    empty = skymosaic("mosaic", "cut.avi", "-o", "m2.png", cwd=tmp_path)
    assert empty.returncode == 2
    assert "empty" in empty.stderr


def test_live_takes_one_source_and_no_report(video: Path, tmp_path: Path) -> None:
    result = skymosaic("mosaic", video, "--live", "--report", "r", "-o", "m.png", cwd=tmp_path)
    assert result.returncode == 2
    assert "--report: no effect with --live" in result.stderr


def test_a_folder_that_cannot_be_read_is_refused_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(_folder: Path) -> Iterator[Path]:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", denied)
    frames = read_live_frames(str(tmp_path), idle_seconds=None, tell=print)
    with pytest.raises(InputError, match=rf"{tmp_path}: cannot be read \(Permission denied\); check its permissions"):
        next(frames)
