"""Runs of `bench/stitchers.py`, and the comparison of flights with OpenStitching and cv2.Stitcher.

Every run is a process of its own with capped memory. Processor time is from the files to the mosaic in memory, imports
not counted. The error of a method is the median distance, in pixels at 1600 px wide, of our matches (inliers of a
pair's homography) under its transformations. The package `stitching` pulls in another OpenCV, so it gets an environment
of its own in the user's cache folder.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.progress import track

from bench.report import Flights, JsonFile, Row, public_folder, report
from golden_model.arrays import Matrix, Points
from golden_model.cache import cache_folder
from skymosaic.flight.flight import Flight
from skymosaic.geometry.homography import apply
from skymosaic.imagery.lens import Lens
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions

METHODS = {
    "skymosaic": "skymosaic",
    "openstitching": "OpenStitching, affine, its ORB",
    "openstitching-sift": "OpenStitching, affine, SIFT",
    "opencv": "`cv2.Stitcher` SCANS",
}
STITCHERS = Path(__file__).with_name("stitchers.py")
REPORTED_WIDTH_PX = 1600
WORKING_WIDTH_PX = 1280
MEMORY_GB = 16.0

Result = dict[str, Any]
Matches = tuple[str, str, Points, Points]
"""Names of two photographs, and their matches in original pixels."""


def peers(flights: Flights, json_file: JsonFile = None) -> None:
    """Photographs placed, error, processor time and memory, beside other stitchers."""
    rows = [row for flight in flights for row in compare(public_folder(flight))]
    report("flights beside other stitchers", rows, json_file)


def compare(folder: Path) -> list[Row]:
    """Every method on a folder."""
    with open_plan([folder], MosaicOptions(working_width_px=WORKING_WIDTH_PX)) as plan:
        flight = plan.flight
    # Our transformations are those of photographs without the distortion that was estimated.
    straight, distorted = (flight_matches(flight, lens) for lens in (Lens(), flight.lens))
    rows: list[Row] = []
    for method in track(METHODS, description=folder.name, transient=True):
        result = run_stitcher(method, folder)
        transforms = result["transforms"]
        placed, failed = max(len(transforms), 1), " (no picture)" * bool(result["failure"])
        scale = REPORTED_WIDTH_PX / flight.views[0].size[0]
        error_px = scale * median_error_px(transforms, straight if method == "skymosaic" else distorted)
        rows.append(
            {
                "flight": f"{folder.name}, {len(flight.views)} photographs",
                "method": METHODS[method],
                "placed": len(transforms),
                "error, px": f"{error_px:.3g}",
                "CPU s per placed photograph": f"{result['cpu_seconds'] / placed:.2f}{failed}",
                "peak, GB": f"{result['peak_mb'] / 1000:.2g}",
            }
        )
    return rows


def run_stitcher(method: str, folder: Path) -> Result:
    """One method on one folder, in a process of its own with capped memory."""
    command = [stitcher_python(method), STITCHERS, method, folder, WORKING_WIDTH_PX, MEMORY_GB]
    finished = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if finished.returncode:
        return {"transforms": {}, "failure": finished.stderr.strip()[-200:], "cpu_seconds": 0.0, "peak_mb": 0.0}
    return json.loads(finished.stdout.splitlines()[-1])


def stitcher_python(method: str) -> str:
    """The interpreter a method runs in; the environment of the package `stitching` is made the first time."""
    if not method.startswith("openstitching"):
        return sys.executable
    environment = cache_folder() / "bench-stitching"
    python = environment / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
        install = [str(python), "-m", "pip", "install", "--quiet"]
        # OpenCV first; the package itself would replace it by another build.
        subprocess.run([*install, "opencv-contrib-python-headless>=5,<6", "numba"], check=True)
        subprocess.run([*install, "--no-deps", "stitching", "largestinteriorrectangle"], check=True)
    return str(python)


def flight_matches(flight: Flight, lens: Lens) -> list[Matches]:
    """Every pair of photographs that a homography joins, with its matches as ``lens`` shows them."""
    matches = []
    for link in (link for link in flight.links if link.holds):
        ends = (flight.views[link.left], link.left_points), (flight.views[link.right], link.right_points)
        left, right = (distort(apply(view.to_original, points), lens) for view, points in ends)
        matches.append((Path(ends[0][0].name).name, Path(ends[1][0].name).name, left, right))
    return matches


def distort(points: Points, lens: Lens) -> Points:
    """Points (N, 2) of a straightened photograph where the camera's picture shows them, px."""
    if lens.matrix is None:
        return points
    to_ray: Matrix = np.linalg.inv(lens.matrix).astype(np.float64)
    rays = cv2.convertPointsToHomogeneous(apply(to_ray, points))
    pixels, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def median_error_px(transforms: dict[str, Any], matches: Sequence[Matches]) -> float:
    """Median distance of matches under transformations to a common frame; NaN where none joins two placed images."""
    errors = [
        np.linalg.norm(apply(np.linalg.inv(transforms[right]) @ transforms[left], points) - targets, axis=1)
        for left, right, points, targets in matches
        if left in transforms and right in transforms
    ]
    return float(np.median(np.concatenate(errors))) if errors else float("nan")
