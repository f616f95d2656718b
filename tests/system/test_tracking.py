"""Tracking a rendered car whose corners are known: through a bridge, by command and by API, by model and by RTL."""

import csv
import json
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from golden_model.config import preset_config
from sim.backends.interface import load_backend
from sim.scene import make_pursuit
from sim.simulators.scoreboard import find_mismatch
from skymosaic.cli.track import track as track_command
from skymosaic.errors import InputError, RegistrationError
from skymosaic.geometry.homography import apply
from skymosaic.imagery.video import VideoReader, write_video
from skymosaic.tracking.template import Roi
from skymosaic.tracking.tracker import track
from tests.system.command_line import skymosaic

IMAGES = 48
RATE = Fraction(25)
HIDDEN = 0.05
"""A car of which the bridge leaves no more than this share is not to be found."""


@pytest.fixture(scope="module")
def film():
    return make_pursuit(seed=1, images=IMAGES, size=(480, 360), bridge=True)


@pytest.fixture(scope="module")
def frames(film) -> list[np.ndarray]:
    return list(film.images)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory, frames) -> Path:
    path = tmp_path_factory.mktemp("video") / "car.mp4"
    with write_video(path, RATE) as write:
        for frame in frames:
            write(frame)
    return path


@pytest.fixture(scope="module")
def short_video(tmp_path_factory: pytest.TempPathFactory, frames) -> Path:
    path = tmp_path_factory.mktemp("video") / "short.mp4"
    with write_video(path, RATE) as write:
        for frame in frames[:3]:
            write(frame)
    return path


@pytest.fixture(scope="module")
def roi(film) -> Roi:
    """The car's bounding box in the first frame."""
    first, last = np.floor(film.corners[0].min(axis=0)), np.ceil(film.corners[0].max(axis=0))
    return Roi(*map(int, first), *map(int, last - first + 1))


def true_corners(film, roi: Roi) -> np.ndarray:
    """Where the rectangle of the first frame moves with the car, (N, 4, 2)."""
    x, y = roi.x_px - 0.5, roi.y_px - 0.5
    outline = np.array([(x, y), (x + roi.width_px, y), (x + roi.width_px, y + roi.height_px), (x, y + roi.height_px)])
    from_first = np.linalg.inv(film.car_to_images[0])
    return np.stack([apply(to_image @ from_first, outline) for to_image in film.car_to_images])


def test_a_car_is_tracked_and_found_again_after_a_bridge_hides_it(film, frames, roi) -> None:
    truth = true_corners(film, roi)
    tracked = list(track(roi, frames))
    found = np.array([each.corners is not None for each in tracked])
    errors = [
        np.linalg.norm(each.corners - truth[each.number], axis=1).mean() for each in tracked if found[each.number]
    ]
    assert np.mean(errors) < 0.5
    assert np.max(errors) < 2.0
    hidden = np.flatnonzero(film.visible <= HIDDEN)
    assert len(hidden) >= 8
    assert not found[hidden].any()
    # Before the bridge it is never lost; behind it, it is found as soon as all of it is seen again.
    assert found[: np.flatnonzero(film.visible < 1)[0]].all()
    assert found[hidden[-1] :][film.visible[hidden[-1] :] >= 1].all()
    assert (film.visible[hidden[-1] :] >= 1).any()


def test_the_command_writes_video_and_corners(film, roi, video: Path, tmp_path: Path) -> None:
    result = skymosaic(
        "track", video, "--roi", ",".join(map(str, roi)), "-o", "out.mp4", "--corners", "c.csv", cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert "lost in frames" in result.stdout
    with (tmp_path / "c.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == IMAGES
    truth = true_corners(film, roi)
    found = [row for row in rows if row["x0"]]
    corners = [[(float(row[f"x{k}"]), float(row[f"y{k}"])) for k in range(4)] for row in found]
    errors = np.linalg.norm(np.array(corners) - truth[[int(row["frame"]) for row in found]], axis=2).mean(axis=1)
    assert errors.mean() < 2.0
    assert len(found) > IMAGES / 2
    for row, frame in zip(rows, VideoReader(tmp_path / "out.mp4"), strict=True):
        if not row["x0"]:
            continue
        x, y = (round((float(row[f"{axis}0"]) + float(row[f"{axis}1"])) / 2) for axis in "xy")
        patch = frame[y - 2 : y + 3, x - 2 : x + 3].astype(int)
        assert (patch[..., 1] - patch[..., [0, 2]].max(axis=2)).max() > 80, "no green edge"


def test_a_template_of_larger_scale_is_found(film, frames, roi, tmp_path: Path) -> None:
    cut = frames[0][roi.y_px : roi.y_px + roi.height_px, roi.x_px : roi.x_px + roi.width_px]
    cv2.imwrite(str(tmp_path / "car.png"), cv2.resize(cut, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC))
    truth = true_corners(film, roi)[3:]
    tracked = list(track(tmp_path / "car.png", frames[3:15]))
    errors = [np.linalg.norm(each.corners - truth[each.number], axis=1).mean() for each in tracked if each.pose]
    assert len(errors) >= 6
    assert np.mean(errors) < 2.0


def test_an_object_that_never_appears_exits_with_3(short_video: Path, tmp_path: Path) -> None:
    grain = np.random.default_rng(3).integers(0, 256, (90, 120, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "grain.png"), cv2.GaussianBlur(grain, (0, 0), 2))
    result = skymosaic("track", "grain.png", short_video, "-o", "out.mp4", cwd=tmp_path)
    assert result.returncode == 3
    assert "found in none of 3 frames" in result.stderr
    assert not (tmp_path / "out.mp4").exists()


@pytest.mark.parametrize(
    ("roi_text", "says"),
    [
        ("1,2,3", "four whole numbers"),
        ("600,400,100,100", "not inside the first frame"),
        ("10,10,8,8", "too small"),
        (None, "TEMPLATE and VIDEO"),
    ],
)
def test_bad_requests_are_one_line_and_leave_no_files(short_video: Path, tmp_path: Path, roi_text, says: str) -> None:
    with pytest.raises(InputError, match=says):
        track_command(inputs=[short_video], output=tmp_path / "out.mp4", roi=roi_text)
    assert list(tmp_path.iterdir()) == []


def test_a_flat_template_is_refused(frames) -> None:
    with pytest.raises(RegistrationError, match="features, 12 needed"):
        list(track(np.full((80, 80, 3), 120, np.uint8), frames[:1]))
    with pytest.raises(InputError, match="template"):
        list(track(np.zeros((10, 10), np.uint16), frames[:1]))


def test_corners_are_written_as_json(short_video: Path, roi, tmp_path: Path) -> None:
    text = ",".join(map(str, roi))
    track_command(inputs=[short_video], output=tmp_path / "out.mkv", roi=text, corners=tmp_path / "c.json")
    assert (tmp_path / "out.mkv").exists()
    rows = json.loads((tmp_path / "c.json").read_text())
    assert [row["frame"] for row in rows] == [0, 1, 2]
    assert all(np.shape(row["corners"]) == (4, 2) for row in rows)


class Recorded:
    """A front end that keeps what it was asked and what it answered."""

    def __init__(self, backend: str) -> None:
        self._front_end = load_backend(backend)
        self.runs: list[tuple] = []

    def run(self, frames, config, *, reference="held"):
        results = self._front_end.run(frames, config, reference=reference)
        self.runs.append((frames, reference, results))
        return results


@pytest.mark.slow
def test_hardware_with_a_held_reference_tracks_the_same_corners(frames, roi, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiles the accelerator the first time."""
    tracked, recorded = {}, {}
    for backend in ("golden", "rtl"):
        recorded[backend] = Recorded(backend)
        monkeypatch.setattr("skymosaic.tracking.tracker.load_backend", lambda name: recorded[name])
        tracked[backend] = list(track(roi, frames[:6], backend=backend, config=preset_config("aerial")))
    assert {reference for _, reference, _ in recorded["rtl"].runs} == {"held"}
    assert sum(len(results[-1].matches) for *_, results in recorded["rtl"].runs) > 100
    for (*_, wanted), (*_, got) in zip(recorded["golden"].runs, recorded["rtl"].runs, strict=True):
        assert find_mismatch(wanted, got) is None
    for wanted, got in zip(tracked["golden"], tracked["rtl"], strict=True):
        np.testing.assert_array_equal(wanted.corners, got.corners)
