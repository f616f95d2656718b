"""Days of three users, from a fresh clone and `pip install .` alone: a surveyor, a roboticist and a data scientist."""

import os
import subprocess
import venv
from pathlib import Path

import cv2
import pytest

from sim.scene import make_pursuit
from tests.skymosaic.panel.tasks.test_mosaic_tasks import write_flight_with_gps
from tests.system.command_line import captured

CLONE = Path(__file__).parents[2]
FRAMES = 12
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("working days")]

SURVEYOR = """
import json, subprocess, sys
import rasterio, rasterio.warp

def run(*words):
    command = [sys.executable, "-I", "-m", "skymosaic", *words, "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)

assert run("check", "flight")["photographs"]
run("mosaic", "flight", "-o", "map.tif", "--report", "report", "--tiles", "tiles", "--require-map")
with rasterio.open("map.tif") as map:
    assert map.crs.to_epsg() == 32632, map.crs
    assert 0.1 < map.res[0] < 0.2, map.res
    west, south, east, north = rasterio.warp.transform_bounds(map.crs, "EPSG:4326", *map.bounds)
    assert west < 7.0 < east and south < 46.0 < north, (west, south, east, north)
    assert map.read().any()
"""
ROBOTICIST = """
from pathlib import Path
import cv2
from skymosaic import LiveMosaic, Roi, Tracker

seen = []
with LiveMosaic(on_frame=seen.append) as live:
    for path in sorted(Path("flight").iterdir()):
        live.add(cv2.imread(str(path)))
assert [update.number for update in seen] == [0, 1, 2, 3]
assert not any(update.reason for update in seen)
assert sorted(live.transforms) == [0, 1, 2, 3]
found = []
with Tracker("car.png", on_frame=found.append) as tracker:
    for path in sorted(Path("film").iterdir()):
        tracker.follow(cv2.imread(str(path)))
assert len(found) == 12 and all(frame.corners is not None for frame in found)
"""
DATA_SCIENTIST = """
import pickle
from itertools import combinations
from pathlib import Path
import numpy as np
from skymosaic import Config, extract, mosaic, register

photographs = sorted(Path("flight").iterdir())
features = [extract(path) for path in photographs]
pairs = [register(*sides) for sides in combinations(features, 2)]
accepted = [pair for pair in pairs if pair.accepted]
assert len(accepted) >= 3
alone = register(photographs[0], photographs[1])
assert np.array_equal(pairs[0].homography, alone.homography)
for pair in accepted:
    assert len(pickle.dumps(pair)) < 1_000_000
    assert len(pair.points().left) == len(pair.inliers)
monday = mosaic(photographs)
tuesday = mosaic(photographs, repeat=monday)
assert all(np.array_equal(*both) for both in zip(monday.transforms, tuesday.transforms, strict=True))
assert isinstance(pairs[0].config, Config)
assert "<img" in monday._repr_html_()
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment with what `pip install .` brings and nothing else, from a clone of HEAD."""
    folder = tmp_path_factory.mktemp("install")
    subprocess.run(["git", "clone", "--quiet", "--depth", "1", CLONE.as_uri(), folder / "clone"], check=True)
    venv.create(folder / "environment", with_pip=True)
    interpreter = folder / "environment" / "bin" / "python"
    subprocess.run([interpreter, "-m", "pip", "install", "--quiet", "."], cwd=folder / "clone", check=True)
    return interpreter


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a flight on the map, and the frames of a film with a picture of its car."""
    folder = tmp_path_factory.mktemp("day")
    (folder / "flight").mkdir()
    (folder / "film").mkdir()
    write_flight_with_gps(folder / "flight")
    film = make_pursuit(9, FRAMES, magnification=3.0)
    for number, frame in enumerate(film.images):
        cv2.imwrite(str(folder / "film" / f"{number:02}.png"), frame)
    low, high = (film.corners[0].min(axis=0) - 6).astype(int), (film.corners[0].max(axis=0) + 6).astype(int)
    cv2.imwrite(str(folder / "car.png"), film.images[0][low[1] : high[1], low[0] : high[0]])
    return folder


@pytest.mark.parametrize(
    "script", [SURVEYOR, ROBOTICIST, DATA_SCIENTIST], ids=["surveyor", "roboticist", "data scientist"]
)
def test_a_working_day(python: Path, day: Path, script: str) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = captured([python, "-I", "-c", script], cwd=day, env=environment)
    assert done.returncode == 0, done.stderr
