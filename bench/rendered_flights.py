"""Rendered flights with known poses: how far the photographs of a mosaic are from their true places.

The position error is taken over a 5x5 grid of each photograph, on the ground, after the best similarity alignment of
all. Uneven light means corners that are 35 % darker, exposure drifting by 6 % and white balance by 3 % from one
photograph to the next.
"""

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.progress import track

from bench.report import JsonFile, PartsOfNames, Row, report
from bench.stitcher_runs import run_stitcher
from golden_model.arrays import Array, Pixels
from sim.scene import Flight, make_lawnmower
from skymosaic.geometry.homography import apply, estimate_similarity, grid_over

LIGHT: dict[str, Any] = {"vignetting": 0.35, "exposure_step": 0.06, "balance_sigma": 0.03}
GRID_POINTS = 5
JPEG_QUALITY = 95
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

    def render(self, seed: int) -> Flight:
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


def rendered(names: PartsOfNames = None, json_file: JsonFile = None) -> None:
    """Position errors of rendered flights; those measured replace their rows in the file."""
    chosen = {name: case for name, case in CASES.items() if not names or any(part in name for part in names)}
    rows = [measure(name, case) for name, case in chosen.items()]
    report("rendered flights", rows, json_file, keep_others=bool(names))


def measure(name: str, case: Case) -> Row:
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


def write_images(folder: Path, images: Iterable[Pixels]) -> list[str]:
    """Write photographs as JPEG; returns their names."""
    names = []
    for index, image in enumerate(images):
        names.append(f"{index:05}.jpg")
        cv2.imwrite(str(folder / names[-1]), image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
    return names


def position_errors(transforms: dict[str, Any], truth: Flight, names: Sequence[str]) -> tuple[Array, Array]:
    """Mean error of each placed photograph on the ground, in ground px, and where it lies, (N,) and (N, 2)."""
    grid = grid_over((truth.camera.width_px, truth.camera.height_px), GRID_POINTS)
    placed = [(index, np.array(transforms[name])) for index, name in enumerate(names) if name in transforms]
    estimated = np.array([apply(transform, grid) for _, transform in placed])
    to_ground = [np.linalg.inv(homography).astype(np.float64) for homography in truth.homographies]
    true = np.array([apply(to_ground[index], grid) for index, _ in placed])
    alignment = estimate_similarity(estimated.reshape(-1, 2), true.reshape(-1, 2))
    return np.linalg.norm(apply(alignment, estimated) - true, axis=-1).mean(axis=1), true.mean(axis=1)
