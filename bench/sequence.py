"""Whole flights: images placed, error, seconds and memory, beside OpenStitching and cv2.Stitcher in one run.

    python bench/sequence.py FOLDER ... [--method NAME ...] [--rounds N] [--json FILE]
    python bench/sequence.py --rendered 100 [--side-overlap 0.3] [--image-width 1600] [--k1 -0.1] [--relief] [--seed N]
        [--json FILE]

Every run is a process of its own with capped memory; the methods take turns, so that a machine whose speed drifts
slows all of them alike. Seconds are from the files to the mosaic in memory, imports not counted. The error of a
method is the median distance, in pixels at 1600 px wide, of our matches (inliers of a pair's homography) under its
transformations. The package `stitching` pulls in another OpenCV, so it gets an environment of its own in the user's
cache folder.

A rendered flight has known poses: the position error is taken over a 5x5 grid of each image, on the ground, after
the best similarity alignment of all. With --k1 the lens bends and darkens the corners by 35 %, and the exposure drifts
by 6 %, the white balance by 3 % from one image to the next; the distortion found is given as a share of the true one.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from golden_model.arrays import Array
from golden_model.config import preset_config
from sim.scene import Flight as RenderedFlight
from sim.scene import make_lawnmower
from sim.simulators.build_cache import cache_folder
from skymosaic.flight.cache import ResultCache
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.survey import Flight, survey
from skymosaic.flight.workers import Workers
from skymosaic.geometry.homography import apply, estimate
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import list_sources

METHODS = ("skymosaic", "openstitching", "openstitching-sift", "opencv")
STITCHERS = Path(__file__).with_name("stitchers.py")
REPORTED_WIDTH_PX = 1600
GRID_POINTS = 5
JPEG_QUALITY = 95

Result = dict[str, Any]
Matches = tuple[str, str, Array, Array]
"""Names of two photographs, and their matches in original pixels."""


def python_of(method: str) -> str:
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


def run(method: str, folder: Path, width_px: int, memory_gb: float) -> Result:
    """One method on one folder, in a process of its own."""
    command = [python_of(method), str(STITCHERS), method, str(folder), str(width_px), str(memory_gb)]
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    if finished.returncode:
        return {
            "transforms": {},
            "failure": finished.stderr.strip()[-200:],
            "seconds": 0.0,
            "cpu_seconds": 0.0,
            "peak_mb": 0.0,
        }
    result: Result = json.loads(finished.stdout.splitlines()[-1])
    return result


def our_flight(folder: Path, width_px: int) -> Flight:
    """The folder, laid out by skymosaic."""
    settings = Settings(preset_config("aerial"), working_width_px=width_px)
    with Workers() as workers:
        return survey(list_sources([folder]), settings, 0, workers, ResultCache(None))


def matches_of(flight: Flight, lens: Lens) -> list[Matches]:
    """Every pair of photographs that a homography joins, with its matches as ``lens`` shows them."""
    found = []
    for link in (link for link in flight.links if link.holds):
        ends = (flight.views[link.left], link.left_points), (flight.views[link.right], link.right_points)
        left, right = (bent(apply(view.to_original, points), lens) for view, points in ends)
        found.append((Path(ends[0][0].name).name, Path(ends[1][0].name).name, left, right))
    return found


def bent(points: Array, lens: Lens) -> Array:
    """Points (N, 2) of a straightened photograph where the camera's picture shows them, px."""
    if lens.matrix is None:
        return points
    rays = cv2.convertPointsToHomogeneous(apply(np.linalg.inv(lens.matrix), points))
    pixels, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def median_error_px(transforms: dict[str, Any], matches: Sequence[Matches], scale: float) -> float:
    """Median distance of matches under transformations to a common frame; NaN where none joins two placed images."""
    errors = [
        np.linalg.norm(apply(np.linalg.inv(transforms[right]) @ transforms[left], points) - targets, axis=1)
        for left, right, points, targets in matches
        if left in transforms and right in transforms
    ]
    return scale * float(np.median(np.concatenate(errors))) if errors else float("nan")


def compare(folder: Path, methods: Sequence[str], rounds: int, width_px: int, memory_gb: float) -> dict[str, Result]:
    """Every method on a folder; seconds and memory are medians over the rounds."""
    flight = our_flight(folder, width_px)
    # Our transformations are those of photographs without the distortion that was found.
    straight, as_seen = matches_of(flight, Lens()), matches_of(flight, flight.lens)
    results: dict[str, list[Result]] = {method: [] for method in methods}
    for _ in track(range(rounds), description=folder.name, transient=True):
        for method in methods:
            results[method].append(run(method, folder, width_px, memory_gb))
    summary = {}
    for method, outcomes in results.items():
        placed = len(outcomes[0]["transforms"])
        seconds = float(np.median([outcome["seconds"] for outcome in outcomes]))
        summary[method] = {
            "placed": placed,
            "error_px": median_error_px(
                outcomes[0]["transforms"],
                straight if method == "skymosaic" else as_seen,
                REPORTED_WIDTH_PX / flight.views[0].size[0],
            ),
            "seconds": seconds,
            "seconds_a_placed_image": seconds / placed if placed else float("nan"),
            "cpu_seconds": float(np.median([outcome["cpu_seconds"] for outcome in outcomes])),
            "peak_mb": float(np.median([outcome["peak_mb"] for outcome in outcomes])),
            "failure": outcomes[0]["failure"],
        }
    return summary


def position_errors(transforms: dict[str, Any], truth: RenderedFlight, names: Sequence[str]) -> tuple[Array, Array]:
    """Mean error of each placed image on the ground, in ground pixels, and where it lies, (N,) and (N, 2)."""
    axes = (np.linspace(0, side - 1, GRID_POINTS) for side in (truth.camera.width_px, truth.camera.height_px))
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    placed = [(index, np.array(transforms[name])) for index, name in enumerate(names) if name in transforms]
    found = np.array([apply(transform, grid) for _, transform in placed])
    from_ground = truth.homographies
    true = np.array([apply(np.linalg.inv(from_ground[index]), grid) for index, _ in placed])
    alignment = estimate(found.reshape(-1, 2), true.reshape(-1, 2), model="similarity")
    return np.linalg.norm(apply(alignment, found) - true, axis=-1).mean(axis=1), true.mean(axis=1)


def rendered(flight: RenderedFlight, width_px: int, memory_gb: float) -> Result:
    """Our mosaic of a rendered survey, against its true poses."""
    count = len(flight.poses)
    names = [f"{index:05}.jpg" for index in range(count)]
    with tempfile.TemporaryDirectory() as folder:
        for name, image in track(zip(names, flight.images, strict=True), "rendering", total=count, transient=True):
            cv2.imwrite(str(Path(folder) / name), image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
        result = run("skymosaic", Path(folder), width_px, memory_gb)
    if not result["transforms"]:
        return result
    errors, places = position_errors(result["transforms"], flight, names)
    outwards = np.argsort(np.linalg.norm(places - places.mean(axis=0), axis=1))
    tenth = max(count // 10, 1)
    middle = (len(outwards) - tenth) // 2
    distortion = flight.camera.k1 / flight.camera.focal_px**2
    return {
        "placed": len(errors),
        "mean_position_error_px": float(errors.mean()),
        "middle_tenth_px": float(errors[outwards[middle : middle + tenth]].mean()),
        "outer_tenth_px": float(errors[outwards[-tenth:]].mean()),
        "distortion_share": result["distortion"] / distortion if distortion else float("nan"),
        "seconds": result["seconds"],
        "cpu_seconds_an_image": result["cpu_seconds"] / count,
        "peak_mb": result["peak_mb"],
        "failure": result["failure"],
    }


def table(title: str, rows: dict[str, Result]) -> Table:
    """One row a method."""
    columns = list(next(iter(rows.values())))
    shown = Table("", *(column.replace("_", " ") for column in columns), title=title)
    for name, row in rows.items():
        shown.add_row(name, *(f"{value:.3g}" if isinstance(value, float) else str(value) for value in row.values()))
    return shown


def main(
    *,
    folders: Annotated[list[Path] | None, typer.Argument(help="Folders of photographs, one flight each.")] = None,
    method: Annotated[list[str] | None, typer.Option(help=f"Only these of {', '.join(METHODS)}.")] = None,
    rounds: Annotated[int, typer.Option(min=1, help="How often each method runs.")] = 3,
    rendered_images: Annotated[int, typer.Option("--rendered", min=0, help="Images of a rendered survey.")] = 0,
    side_overlap: Annotated[float, typer.Option(help="Of the rendered survey's legs.")] = 0.3,
    seed: Annotated[int, typer.Option(min=0, help="Of the rendered survey.")] = 3,
    image_width_px: Annotated[int, typer.Option("--image-width", help="Of the rendered survey; 4:3.")] = 1600,
    k1: Annotated[float, typer.Option(help="Distortion of the rendered survey; not 0: vignetting and drifts too.")] = 0,
    relief: Annotated[bool, typer.Option("--relief", help="Buildings and trees stand above the ground.")] = False,
    working_width_px: Annotated[int, typer.Option("--working-width", help="For all methods.")] = 1280,
    memory_gb: Annotated[float, typer.Option("--memory", help="Cap of each process's address space.")] = 16,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here.")] = None,
) -> None:
    """Print a table for each flight."""
    console = Console(width=150)
    figures: dict[str, Any] = {}
    for folder in folders or []:
        figures[folder.name] = compare(folder, method or METHODS, rounds, working_width_px, memory_gb)
        console.print(table(folder.name, figures[folder.name]))
    if rendered_images:
        size = (image_width_px, image_width_px * 3 // 4)
        light = {"vignetting": 0.35, "exposure_step": 0.06, "balance_sigma": 0.03} if k1 else {}
        flight = make_lawnmower(seed, rendered_images, size, side_overlap=side_overlap, k1=k1, relief=relief, **light)
        name = f"rendered, {rendered_images} images {size[0]}x{size[1]}, side overlap {side_overlap:.0%}, k1 {k1}"
        name += f", {'relief' if relief else 'flat'}, seed {seed}"
        figures[name] = rendered(flight, working_width_px, memory_gb)
        console.print(table(name, {"skymosaic": figures[name]}))
    if json_file:
        json_file.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
