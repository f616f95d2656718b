"""Quality of mosaics without ground truth, and their cost.

Every mosaic is made by the command line in a process of its own, from an empty cache. For each photograph, the mosaic
is warped back into its frame and compared with it.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio

from bench.report import Flights, JsonFile, Row, public_folder, report
from golden_model.arrays import Array, Matrix, Pixels
from skymosaic.compositing.warp import magnification
from skymosaic.geometry.homography import resize_matrix
from skymosaic.imagery.lens import Lens, lens_of

COMPARED_AT_PX = 1600
"""Width at which errors are given, whatever the working width was."""
COMPARED_WIDTH_PX = 800
SHARPNESS_SIDE_PX = 384
HIGH_PASS_PX = 6.0


def quality(flights: Flights, json_file: JsonFile = None) -> None:
    """Quality of mosaics without ground truth, and their cost.

    Error: median of the tie points at 1600 px wide. CPU: from the files to the mosaic and the report. Brightness kept:
    the mosaic's against the photograph's, with the smallest and largest. Burnt: pixels that are white in the mosaic and
    not in the photograph. Misfit: mean absolute difference from the photograph once both have the same mean and
    contrast. NCC: correlation with the photograph after a high-pass, with the tenth percentile; what is out of place
    lowers it. Sharp: energy of fine detail against the photograph warped by a Lanczos kernel, which keeps nearly all.
    """
    rows = []
    for flight in flights:
        folder = public_folder(flight)
        with tempfile.TemporaryDirectory() as temporary:
            mosaic, cpu_seconds = make_mosaic(folder.resolve(), Path(temporary))
            summary = json.loads((Path(temporary) / "report" / "report.json").read_text())
            rows.append(quality_row(folder.name, summary, measure_photographs(mosaic, summary), cpu_seconds))
    report("quality of mosaics", rows, json_file)


def quality_row(name: str, summary: dict[str, Any], measures: Array, cpu_seconds: float) -> Row:
    """A flight's medians and extremes."""
    kept, burnt, misfit, ncc, sharp = measures.T
    mosaic = summary["mosaics"][0]
    placed, scale = mosaic["placed"], COMPARED_AT_PX / summary["working_width_px"]
    return {
        "flight": name,
        "placed": f"{placed} of {summary['photographs']}",
        "error, px": f"{scale * mosaic['median_error_px']:.2f}",
        "CPU s per photograph": f"{cpu_seconds / placed:.2f}",
        "brightness kept": f"{np.median(kept):.2f} ({kept.min():.2f}, {kept.max():.2f})",
        "burnt, %": f"{100 * burnt.mean():.2f}",
        "misfit, %": f"{100 * np.median(misfit):.1f}",
        "NCC": f"{np.median(ncc):.2f} ({np.quantile(ncc, 0.1):.2f})",
        "sharp": f"{np.nanmedian(sharp):.2f}",
    }


def make_mosaic(folder: Path, target: Path) -> tuple[Path, float]:
    """Make the mosaic and its report in the folder ``target``; returns its file and seconds of processor time."""
    # Photographs of 16 bits keep their numbers in .tif files only.
    deep = any(path.suffix.lower() in (".tif", ".tiff") for path in folder.iterdir())
    mosaic = target / ("mosaic.tif" if deep else "mosaic.png")
    command = [sys.executable, "-m", "skymosaic", "mosaic", str(folder), "-o", mosaic.name, "--report", "report"]
    process = subprocess.Popen([*command, "--cache", "cache", "--quiet"], stdout=subprocess.DEVNULL, cwd=target)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"failed: {' '.join(command)}")
    return mosaic, usage.ru_utime + usage.ru_stime


def read_picture(path: Path) -> Pixels:
    """The mosaic in 8 bits a channel, BGR. OpenCV reads no TIFF file of gray and alpha."""
    if path.suffix == ".png":
        return np.asarray(cv2.imread(str(path)), dtype=np.uint8)
    with rasterio.open(path) as raster:
        bands = raster.read([3, 2, 1] if raster.count > 2 else [1, 1, 1])
    return np.ascontiguousarray(np.moveaxis(bands if bands.dtype == np.uint8 else bands >> 8, 0, -1).astype(np.uint8))


def measure_photographs(mosaic_path: Path, summary: dict[str, Any]) -> Array:
    """The measures of each photograph, (N, 5)."""
    mosaic, transforms = read_picture(mosaic_path), summary["mosaics"][0]["transforms"]
    lens, rows = lens_of(summary["lens"]) if summary["lens"] else Lens(), []
    for name, matrix in transforms.items():
        photograph = lens.straighten(np.asarray(cv2.imread(name), np.uint8))
        if row := measure_photograph(mosaic, np.asarray(photograph, np.uint8), np.array(matrix)):
            rows.append(row)
    return np.array(rows)


def measure_photograph(mosaic: Pixels, photograph: Pixels, to_mosaic: Matrix) -> tuple[float, ...] | None:
    """The measures of one photograph; None where the mosaic shows less than half of it."""
    scale = COMPARED_WIDTH_PX / photograph.shape[1]
    small = cv2.resize(photograph, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    # Reduced first: warping down by a large factor without it would alias.
    factor = max(1, round(1 / scale / magnification((photograph.shape[1], photograph.shape[0]), to_mosaic)))
    reduced = cv2.resize(mosaic, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    back = resize_matrix(scale) @ np.linalg.inv(to_mosaic) @ np.linalg.inv(resize_matrix(1 / factor))
    warped = cv2.warpPerspective(reduced, back, small.shape[1::-1], flags=cv2.INTER_LINEAR)
    valid = warped.sum(axis=2) > 0
    if valid.mean() < 0.5:
        return None
    kept = float(warped[valid].mean() / small[valid].mean())
    burnt = float((warped[valid].min(axis=1) > 250).mean() - (small[valid].min(axis=1) > 250).mean())
    a, b = (cv2.cvtColor(part, cv2.COLOR_BGR2GRAY).astype(np.float32) for part in (warped, small))
    fitted = (a - a[valid].mean()) * b[valid].std() / max(a[valid].std(), 1e-6) + b[valid].mean()
    misfit = float(np.abs(fitted - b)[valid].mean() / b[valid].mean())
    inside = cv2.erode(valid.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    high = [plane - cv2.GaussianBlur(plane, (0, 0), HIGH_PASS_PX) for plane in (a, b)]
    ncc = float(np.corrcoef(high[0][inside], high[1][inside])[0, 1])
    return kept, burnt, misfit, ncc, sharpness(mosaic, photograph, to_mosaic)


def sharpness(mosaic: Pixels, photograph: Pixels, to_mosaic: Matrix) -> float:
    """Laplacian energy in a window around the photograph's centre, relative to the local mean; NaN off the mosaic."""
    side = SHARPNESS_SIDE_PX
    centre = to_mosaic @ np.array([photograph.shape[1] / 2, photograph.shape[0] / 2, 1.0])
    x, y = (centre[:2] / centre[2] - side / 2).round().astype(int)
    if min(x, y) < 0 or y + side > len(mosaic) or x + side > mosaic.shape[1]:
        return float("nan")
    window = mosaic[y : y + side, x : x + side]
    to_window = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1]]) @ to_mosaic
    best = cv2.warpPerspective(photograph, to_window, (side, side), flags=cv2.INTER_LANCZOS4)
    energies = []
    for picture in (window, best):
        gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.float32)
        energies.append(float((cv2.Laplacian(gray, cv2.CV_32F) ** 2).mean() / gray.mean() ** 2))
    return energies[0] / max(energies[1], 1e-9)
