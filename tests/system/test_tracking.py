"""Tracking by command: a rendered car's outline in a video, and its corners as numbers."""

import csv
import json
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.scene import Pursuit
from skymosaic.imagery.video import VideoReader, write_video
from skymosaic.tracking.template import Roi
from tests.skymosaic.tracking.conftest import true_corners
from tests.system.command_line import skymosaic

RATE, SHOWN = Fraction(25), 18


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory, film: Pursuit) -> Path:
    """The car until a bridge hides it."""
    path = tmp_path_factory.mktemp("video") / "car.mp4"
    with write_video(path, RATE) as write:
        for frame in film.images[:SHOWN]:
            write(frame)
    return path


@pytest.fixture(scope="module")
def short_video(tmp_path_factory: pytest.TempPathFactory, film: Pursuit) -> Path:
    path = tmp_path_factory.mktemp("video") / "short.mp4"
    with write_video(path, RATE) as write:
        for frame in film.images[:3]:
            write(frame)
    return path


def test_the_command_writes_video_and_corners(film: Pursuit, roi: Roi, video: Path, tmp_path: Path) -> None:
    result = skymosaic(
        "track", video, "--roi", ",".join(map(str, roi)), "-o", "out.mp4", "--corners", "c.csv", cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert "lost: hidden" in result.stdout
    with (tmp_path / "c.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == SHOWN
    truth = true_corners(film, roi)
    found = [row for row in rows if row["x0"]]
    corners = [[(float(row[f"x{k}"]), float(row[f"y{k}"])) for k in range(4)] for row in found]
    errors = np.linalg.norm(np.array(corners) - truth[[int(row["frame"]) for row in found]], axis=2).mean(axis=1)
    assert errors.mean() < 2.0
    assert len(found) > SHOWN / 2
    for row, frame in zip(rows, VideoReader(tmp_path / "out.mp4"), strict=True):
        if not row["x0"]:
            continue
        x, y = (round((float(row[f"{axis}0"]) + float(row[f"{axis}1"])) / 2) for axis in "xy")
        patch = frame[y - 2 : y + 3, x - 2 : x + 3].astype(int)
        assert (patch[..., 1] - patch[..., [0, 2]].max(axis=2)).max() > 80, "no green edge"


def test_an_object_that_never_appears_exits_with_3(short_video: Path, tmp_path: Path) -> None:
    grain = np.random.default_rng(3).integers(0, 256, (90, 120, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "grain.png"), cv2.GaussianBlur(grain, (0, 0), 2))
    result = skymosaic("track", "grain.png", short_video, "-o", "out.mp4", cwd=tmp_path)
    assert result.returncode == 3
    assert "found in none of 3 frames" in result.stderr
    assert not (tmp_path / "out.mp4").exists()


def test_every_frame_is_a_line_of_json(short_video: Path, roi: Roi, tmp_path: Path) -> None:
    text = ",".join(map(str, roi))
    result = skymosaic("track", short_video, "--roi", text, "-o", "out.mkv", "--json", cwd=tmp_path)
    *frames, whole = map(json.loads, result.stdout.splitlines())
    assert [frame["name"] for frame in frames] == [f"{short_video}/frame {number}" for number in range(3)]
    assert all(frame["placed"] and np.shape(frame["pose"]) == (3, 3) for frame in frames)
    assert [frame["corners"] for frame in frames] == [row["corners"] for row in whole["corners"]]
