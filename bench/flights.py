"""Whole flights: what is placed, how exactly, how the mosaics look, and what it costs.

    python -m bench.flights peers FLIGHT ...
    python -m bench.flights rendered [NAME ...]
    python -m bench.flights maps FLIGHT ...
    python -m bench.flights quality FLIGHT ...
    python -m bench.flights errors FLIGHT ...
    python -m bench.flights nuisances [NAME ...]

A FLIGHT is a folder of photographs, or the name of a public flight below SKYMOSAIC_DATA, such as ``brighton_beach``.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio
from rich.console import Console
from rich.progress import track

from bench.flight_quality import WIDTH_PX as REPORTED_WIDTH_PX
from bench.flight_quality import errors, quality, write_images
from bench.nuisances import nuisances
from bench.report import Flights, JsonFile, PartsOfNames, Row, program, public_folder, report
from golden_model.arrays import Array, Matrix, Points
from golden_model.cache import cache_folder
from golden_model.pixel.gray import to_gray
from sim.scene import Flight as RenderedFlight
from sim.scene import make_lawnmower
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.flight import Flight
from skymosaic.geometry.homography import apply, estimate_similarity, grid_over
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import list_sources
from skymosaic.maps.base_map import BaseMap, load_base_map
from skymosaic.maps.georeference import reproject
from skymosaic.mosaicking.api import mosaic, open_run
from skymosaic.mosaicking.options import MosaicOptions

app = program(__doc__)
for command in (quality, errors, nuisances):
    app.command()(command)

METHODS = {
    "skymosaic": "skymosaic",
    "openstitching": "OpenStitching, affine, its ORB",
    "openstitching-sift": "OpenStitching, affine, SIFT",
    "opencv": "`cv2.Stitcher` SCANS",
}
STITCHERS = Path(__file__).with_name("stitchers.py")
WORKING_WIDTH_PX = 1280
MEMORY_GB = 16.0

Result = dict[str, Any]
Matches = tuple[str, str, Points, Points]
"""Names of two photographs, and their matches in original pixels."""
LIGHT: dict[str, Any] = {"vignetting": 0.35, "exposure_step": 0.06, "balance_sigma": 0.03}
GRID_POINTS = 5
PATCH_PX, REACH_PX, MIN_CORRELATION = 96, 64, 0.6
"""Side of a patch of a map, how far it is searched in another one, and how well it must fit there."""
SEEDS = (1, 2, 3, 4)


@dataclass(frozen=True)
class Case:
    """How a lawnmower flight is rendered."""

    images: int
    width_px: int
    side_overlap: float
    relief: bool = False
    k1: float = 0.0
    uneven_light: bool = False
    seeds: tuple[int, ...] = (3,)

    def render(self, seed: int) -> RenderedFlight:
        """The flight of a seed."""
        light = LIGHT if self.uneven_light else {}
        size = self.width_px, self.width_px * 3 // 4
        return make_lawnmower(
            seed, self.images, size, side_overlap=self.side_overlap, k1=self.k1, relief=self.relief, **light
        )


CASES = {
    "100 of 1600×1200, 30 % side overlap": Case(100, 1600, 0.3),
    "500 of 1600×1200, 60 %": Case(500, 1600, 0.6),
    "50 of 640×480, 60 %": Case(50, 640, 0.6),
    "500 of 640×480, 60 %": Case(500, 640, 0.6),
    "3,000 of 640×480, 60 %": Case(3000, 640, 0.6),
    "60 of 800×600, buildings and trees with height": Case(60, 800, 0.5, relief=True),
    "the same through a lens, in uneven light": Case(60, 800, 0.5, relief=True, k1=-0.1, uneven_light=True),
    "30 of 640×480, 50 %": Case(30, 640, 0.5, seeds=SEEDS),
    "30 in uneven light": Case(30, 640, 0.5, uneven_light=True, seeds=SEEDS),
    "30 through a lens": Case(30, 640, 0.5, k1=-0.1, seeds=SEEDS),
    "30 through a lens, in uneven light": Case(30, 640, 0.5, k1=-0.1, uneven_light=True, seeds=SEEDS),
}
"""Photographs, and what is special; the last four are means of four flights."""


@app.command()
def peers(flights: Flights, json_file: JsonFile = None) -> None:
    """Photographs placed, error, processor time and memory, beside other stitchers.

    Processor time is from the files to the mosaic in memory, imports not counted. The error of a method is the median
    distance, in pixels at 1600 px wide, of our matches (inliers of a pair's homography) under its transformations.
    """
    rows = [row for flight in flights for row in peer_rows(public_folder(flight))]
    report("flights beside other stitchers", rows, json_file)


def peer_rows(folder: Path) -> list[Row]:
    """Every method on a folder."""
    with open_run([folder], MosaicOptions(working_width_px=WORKING_WIDTH_PX)) as run:
        flight = run.flight
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
    """One method of `bench/stitchers.py` on one folder, in a process of its own with capped memory."""
    command = [stitcher_python(method), STITCHERS, method, folder, WORKING_WIDTH_PX, MEMORY_GB]
    finished = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if finished.returncode:
        return {"transforms": {}, "failure": finished.stderr.strip()[-200:], "cpu_seconds": 0.0, "peak_mb": 0.0}
    return json.loads(finished.stdout.splitlines()[-1])


def stitcher_python(method: str) -> str:
    """The interpreter a method runs in.

    The package `stitching` pulls in another OpenCV. Its environment, in the user's cache folder, is made the first
    time.
    """
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


@app.command()
def rendered(names: PartsOfNames = None, json_file: JsonFile = None) -> None:
    """Position errors of rendered flights with known poses; those measured replace their rows in the file.

    The error is taken over a 5x5 grid of each photograph, on the ground, after the best similarity alignment of all.
    Uneven light means corners that are 35 % darker, exposure drifting by 6 % and white balance by 3 % from one
    photograph to the next.
    """
    chosen = {name: case for name, case in CASES.items() if not names or any(part in name for part in names)}
    rows = [rendered_row(name, case) for name, case in chosen.items()]
    report("rendered flights", rows, json_file, keep_others=bool(names))


def rendered_row(name: str, case: Case) -> Row:
    """The mean over the seeds of a case."""
    results = [run_case(case, seed) for seed in track(case.seeds, name, console=Console(stderr=True))]
    mean = {key: float(np.mean([result[key] for result in results])) for key in results[0]}
    return {
        "photographs": name,
        "placed": round(mean["placed"] * case.images),
        "position error, px": f"{mean['error_px']:.3f}",
        "outer tenth": f"{mean['outer_px']:.3f}",
        "share of k1 estimated": f"{mean['distortion']:.3f}" if case.k1 else "",
        "CPU s per photograph": f"{mean['cpu_seconds'] / case.images:.2f}",
        "peak, GB": f"{max(result['peak_mb'] for result in results) / 1000:.2f}",
    }


def run_case(case: Case, seed: int) -> dict[str, float]:
    """Our mosaic of one flight, against its true poses."""
    flight = case.render(seed)
    camera = flight.camera
    with tempfile.TemporaryDirectory() as temporary:
        names = write_images(Path(temporary), flight.images)
        result = run_stitcher("skymosaic", Path(temporary))
    if result["failure"]:
        raise SystemExit(f"no mosaic of a rendered flight, seed {seed}: {result['failure']}")
    errors, places = position_errors(result["transforms"], flight, names)
    outwards = np.argsort(np.linalg.norm(places - places.mean(axis=0), axis=1))
    tenth = max(case.images // 10, 1)
    true_distortion = camera.k1 / camera.focal_px**2
    return {
        "placed": len(errors) / case.images,
        "error_px": float(errors.mean()),
        "outer_px": float(errors[outwards[-tenth:]].mean()),
        "distortion": result["distortion"] / true_distortion if true_distortion else 0.0,
        "cpu_seconds": result["cpu_seconds"],
        "peak_mb": result["peak_mb"],
    }


def position_errors(transforms: dict[str, Any], truth: RenderedFlight, names: Sequence[str]) -> tuple[Array, Array]:
    """Mean error of each placed photograph on the ground, in ground px, and where it lies, (N,) and (N, 2)."""
    grid = grid_over((truth.camera.width_px, truth.camera.height_px), GRID_POINTS)
    placed = [(index, np.array(transforms[name])) for index, name in enumerate(names) if name in transforms]
    estimated = np.array([apply(transform, grid) for _, transform in placed])
    to_ground = [np.linalg.inv(homography).astype(np.float64) for homography in truth.homographies]
    true = np.array([apply(to_ground[index], grid) for index, _ in placed])
    alignment = estimate_similarity(estimated.reshape(-1, 2), true.reshape(-1, 2))
    return np.linalg.norm(apply(alignment, estimated) - true, axis=-1).mean(axis=1), true.mean(axis=1)


@app.command()
def maps(flights: Flights, json_file: JsonFile = None) -> None:
    """How far the second half of a flight lies from the map of the first: by its own GPS, and laid onto it.

    Patches of the one map that normalised correlation finds in the other: median and 90th percentile of their
    distances, in whole pixels of the map.
    """
    report("the second half of a flight on the first", [halves_row(public_folder(each)) for each in flights], json_file)


def halves_row(folder: Path) -> Row:
    """One flight, whose halves are its files in order."""
    files = [str(file) for source in list_sources([folder]) for file in source.files]
    first = mosaic(files[: len(files) // 2])
    row: Row = {"flight": f"{folder.name}, {len(files)} photographs", "photographs that hold": ""}
    if first.composition.place.georeference is None:
        return {**row, "by GPS": "the first half has no map", "laid onto it": ""}
    with tempfile.TemporaryDirectory() as temporary:
        paths = [Path(temporary) / f"{name}.tif" for name in ("first", "by GPS", "laid onto it")]
        first.save(paths[0])
        for path, onto in zip(paths[1:], (None, load_base_map(paths[0])), strict=True):
            second = mosaic(files[len(files) // 2 :], onto=onto)
            second.save(path)
            if (ties := second.flight.onto) is not None:
                row["photographs that hold"] = ties.description.partition(" photo")[0]
            off_px = map_offsets_px(*map(load_base_map, (paths[0], path)))
            row[path.stem] = "{:.2f} / {:.2f} px".format(*np.percentile(off_px, (50, 90))) + f", {len(off_px)} patches"
    return row


def map_offsets_px(first: BaseMap, second: BaseMap) -> Array:
    """Distances of a map's patches from their places on the ``first``, (N,), px of that, where they are found."""
    boxes = []
    for each in (first, second):
        with rasterio.open(each.name) as file:
            outline = reproject(apply(each.to_map, Canvas(0, 0, file.width, file.height).corners), each.crs, first.crs)
        boxes.append(apply(np.asarray(np.linalg.inv(first.to_map), np.float64), outline))
    low = np.max([box.min(axis=0) for box in boxes], axis=0).round()
    size = np.min([box.max(axis=0) for box in boxes], axis=0).round() - low
    to_map = first.to_map @ np.array([[1, 0, low[0]], [0, 1, low[1]], [0, 0, 1]])
    pieces = [each.cut((int(size[0]), int(size[1])), to_map, first.crs) for each in (first, second)]
    (one, shown), (other, also) = ((to_gray(x.pixels), np.asarray(x.visible)) for x in pieces if x is not None)
    off_px = []
    for y, x in product(*(range(0, side - PATCH_PX - 2 * REACH_PX, PATCH_PX) for side in one.shape)):
        around = np.s_[y : y + PATCH_PX + 2 * REACH_PX, x : x + PATCH_PX + 2 * REACH_PX]
        if shown[around].all() and also[around].all():
            patch = other[around][REACH_PX:-REACH_PX, REACH_PX:-REACH_PX]
            _, best, _, place = cv2.minMaxLoc(cv2.matchTemplate(one[around], patch, cv2.TM_CCOEFF_NORMED))
            if best > MIN_CORRELATION:
                off_px.append(np.hypot(place[0] - REACH_PX, place[1] - REACH_PX))
    return np.array(off_px)


if __name__ == "__main__":
    app()
