"""Quality of mosaics without ground truth, and their cost: one row of Markdown for each flight.

    python bench/quality.py FOLDER ...

Every mosaic is made by the command line in a process of its own, from an empty cache. For each photograph, the mosaic
is warped back into its frame and compared with it:

error    median reprojection error of the tie points at 1600 px wide
CPU      seconds of processor time for each placed photograph, from the files to the mosaic and the report
kept     brightness of the mosaic against the photograph's: median, smallest, largest
burnt    share of pixels that are white in the mosaic and not in the photograph, percent
misfit   mean absolute difference from the photograph once both have the same mean and contrast, percent of the mean
NCC      correlation with the photograph after a high-pass: what is out of place lowers it; median and tenth percentile
sharp    energy of fine detail in the mosaic against the photograph warped by a Lanczos kernel, which keeps nearly all
"""

from __future__ import annotations

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
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.float32]

COMPARED_AT_PX = 1600
"""Width at which errors are given, whatever the working width was."""
COMPARED_WIDTH_PX = 800
SHARPNESS_SIDE_PX = 384
HIGH_PASS_PX = 6.0


def main(folders: list[str]) -> None:
    """Print the table."""
    columns = ("flight", "placed", "error, px", "CPU, s", "kept", "burnt, %", "misfit, %", "NCC", "sharp")
    print("|", " | ".join(columns), "|\n|" + "---|" * len(columns))
    for folder in folders:
        with tempfile.TemporaryDirectory() as made:
            mosaic, cpu_seconds = mosaic_of(Path(folder).resolve(), Path(made))
            report = json.loads((Path(made) / "report" / "report.json").read_text())
            numbers = report["mosaics"][0]
            kept, burnt, misfit, ncc, sharp = measures(mosaic, report).T
        placed, scale = numbers["placed"], COMPARED_AT_PX / report["working_width_px"]
        print(
            f"| {Path(folder).name} | {placed} of {report['photographs']} | {scale * numbers['median_error_px']:.2f}"
            f" | {cpu_seconds / placed:.2f} | {np.median(kept):.2f} ({kept.min():.2f}, {kept.max():.2f})"
            f" | {100 * burnt.mean():.2f} | {100 * np.median(misfit):.1f}"
            f" | {np.median(ncc):.2f} ({np.quantile(ncc, 0.1):.2f}) | {np.nanmedian(sharp):.2f} |",
            flush=True,
        )


def mosaic_of(folder: Path, made: Path) -> tuple[Path, float]:
    """Make the mosaic and its report in the folder ``made``; returns its file and seconds of processor time."""
    # Photographs of 16 bits keep their numbers in .tif files only.
    deep = any(path.suffix.lower() in (".tif", ".tiff") for path in folder.iterdir())
    mosaic = made / ("mosaic.tif" if deep else "mosaic.png")
    command = [sys.executable, "-m", "skymosaic", "mosaic", str(folder), "-o", mosaic.name, "--report", "report"]
    process = subprocess.Popen([*command, "--cache", "cache"], cwd=made, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{folder}: no mosaic; run skymosaic mosaic on it to see why")
    return mosaic, usage.ru_utime + usage.ru_stime


def picture(path: Path) -> NDArray[np.uint8]:
    """The mosaic in 8 bits a channel, BGR. OpenCV reads no TIFF file of gray and alpha."""
    if path.suffix == ".png":
        return np.asarray(cv2.imread(str(path)), dtype=np.uint8)
    with rasterio.open(path) as raster:
        bands = raster.read([3, 2, 1] if raster.count > 2 else [1, 1, 1])
    return np.ascontiguousarray(np.moveaxis(bands if bands.dtype == np.uint8 else bands >> 8, 0, -1).astype(np.uint8))


def measures(mosaic_path: Path, report: dict[str, Any]) -> Array:
    """The measures of each photograph, (N, 5)."""
    mosaic, transforms = picture(mosaic_path), report["mosaics"][0]["transforms"]
    photographs = ((straightened(cv2.imread(name), report.get("lens")), matrix) for name, matrix in transforms.items())
    return np.array([row for photo, matrix in photographs if (row := measured(mosaic, photo, np.array(matrix)))])


def straightened(photograph: NDArray[np.uint8], lens: dict[str, float] | None) -> NDArray[np.uint8]:
    """The photograph without the distortion that the report names."""
    if lens is None:
        return photograph
    x, y = (photograph.shape[1] - 1) / 2, (photograph.shape[0] - 1) / 2
    matrix = np.array([[lens["focal_px"], 0, x], [0, lens["focal_px"], y], [0, 0, 1]])
    return cv2.undistort(photograph, matrix, np.array([lens["k1"], 0, 0, 0, 0]))


def measured(mosaic: NDArray[np.uint8], photograph: NDArray[np.uint8], to_mosaic: Array) -> tuple[float, ...] | None:
    """The measures of one photograph; None where the mosaic shows less than half of it."""
    scale = COMPARED_WIDTH_PX / photograph.shape[1]
    small = cv2.resize(photograph, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    to_small = np.array([[scale, 0, (scale - 1) / 2], [0, scale, (scale - 1) / 2], [0, 0, 1]])
    # Reduced first: warping down by a large factor without it would alias.
    factor = max(1, round(1 / scale / local_scale(to_mosaic, photograph.shape)))
    reduced = cv2.resize(mosaic, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    shrink = np.array([[1 / factor, 0, (1 / factor - 1) / 2], [0, 1 / factor, (1 / factor - 1) / 2], [0, 0, 1]])
    back = to_small @ np.linalg.inv(to_mosaic) @ np.linalg.inv(shrink)
    seen = cv2.warpPerspective(reduced, back, small.shape[1::-1], flags=cv2.INTER_LINEAR)
    valid = seen.sum(axis=2) > 0
    if valid.mean() < 0.5:
        return None
    kept = float(seen[valid].mean() / small[valid].mean())
    burnt = float((seen[valid].min(axis=1) > 250).mean() - (small[valid].min(axis=1) > 250).mean())
    a, b = (cv2.cvtColor(part, cv2.COLOR_BGR2GRAY).astype(np.float32) for part in (seen, small))
    fitted = (a - a[valid].mean()) * b[valid].std() / max(a[valid].std(), 1e-6) + b[valid].mean()
    misfit = float(np.abs(fitted - b)[valid].mean() / b[valid].mean())
    inside = cv2.erode(valid.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    high = [plane - cv2.GaussianBlur(plane, (0, 0), HIGH_PASS_PX) for plane in (a, b)]
    ncc = float(np.corrcoef(high[0][inside], high[1][inside])[0, 1])
    return kept, burnt, misfit, ncc, sharpness(mosaic, photograph, to_mosaic)


def local_scale(matrix: Array, shape: tuple[int, ...]) -> float:
    """Mosaic pixels for each photograph pixel, at the photograph's centre."""
    centre = np.array([shape[1] / 2, shape[0] / 2, 1.0])
    w = matrix[2] @ centre
    mapped = matrix[:2] @ centre / w
    jacobian = (matrix[:2, :2] - np.outer(mapped, matrix[2, :2])) / w
    return float(np.sqrt(abs(np.linalg.det(jacobian))))


def sharpness(mosaic: NDArray[np.uint8], photograph: NDArray[np.uint8], to_mosaic: Array) -> float:
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


if __name__ == "__main__":
    main(sys.argv[1:])
