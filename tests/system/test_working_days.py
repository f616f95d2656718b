"""Days of two users, from a fresh clone and `pip install .` alone: a surveyor and a roboticist."""

import os
import subprocess
import venv
from pathlib import Path

import pytest

from tests.skymosaic.panel.tasks.test_mosaic_tasks import write_flight_with_gps
from tests.system.command_line import captured

CLONE = Path(__file__).parents[2]
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

frames = [cv2.imread(str(path)) for path in sorted(Path("flight").iterdir())]
with LiveMosaic() as live, Tracker(Roi(100, 80, 120, 90)) as tracker:
    for frame in frames:
        assert not live.add(frame).reason
    assert all(tracker.follow(frames[0]).corners is not None for _ in range(2))
assert sorted(live.transforms) == [0, 1, 2, 3]
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


@pytest.mark.parametrize("script", [SURVEYOR, ROBOTICIST], ids=["surveyor", "roboticist"])
def test_a_working_day(python: Path, tmp_path: Path, script: str) -> None:
    (tmp_path / "flight").mkdir()
    write_flight_with_gps(tmp_path / "flight")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = captured([python, "-I", "-c", script], cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr
