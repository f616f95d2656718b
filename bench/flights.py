"""Whole flights: what is placed, how exactly, how the mosaics look, and what it costs.

    python -m bench.flights rendered [NAME ...]
    python -m bench.flights maps FLIGHT ...
    python -m bench.flights quality FLIGHT ...
    python -m bench.flights errors FLIGHT ...
    python -m bench.flights nuisances [NAME ...]

A FLIGHT is a folder of photographs, or the name of a public flight below SKYMOSAIC_DATA, such as ``brighton_beach``.
"""

import resource
import tempfile
import time
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

from bench.flight_quality import errors, quality, write_images
from bench.nuisances import nuisances
from bench.report import Flights, JsonFile, PartsOfNames, Row, in_process, program, public_folder, report
from golden_model.arrays import Array
from golden_model.pixel.gray import to_gray
from sim.scene import Flight as RenderedFlight
from sim.scene import make_lawnmower
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import apply, estimate_similarity, grid_over
from skymosaic.imagery.photographs import list_sources
from skymosaic.maps.base_map import BaseMap, load_base_map
from skymosaic.maps.georeference import reproject
from skymosaic.mosaicking.api import mosaic

app = program(__doc__)
for command in (quality, errors, nuisances):
    app.command()(command)

WORKING_WIDTH_PX = 1280

Result = dict[str, Any]
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
        result = in_process(measure_mosaic, [Path(temporary) / name for name in names])
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


def measure_mosaic(paths: list[Path]) -> Result:
    """Transformations of our mosaic by the names of its files, the lens, and what both took."""
    start = time.process_time()
    with tempfile.TemporaryDirectory() as cache:
        made = mosaic(paths, working_width_px=WORKING_WIDTH_PX, canvas_limit_px=10**9, cache=Path(cache))
    numbers = made.flight.lens.numbers
    return {
        "transforms": {paths[index].name: made.transforms[index] for index in made.placed},
        # As k1 over the square of the focal length, because tie points do not determine the focal length.
        "distortion": numbers["k1"] / numbers["focal_x_px"] ** 2 if numbers else 0.0,
        "cpu_seconds": time.process_time() - start,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
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
