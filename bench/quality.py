"""Quality of a mosaic without ground truth, from the picture and its report alone.

python bench/quality.py MOSAIC REPORT.json [MOSAIC REPORT.json ...]

For each photograph, the mosaic is warped back into its frame and compared with it:

kept     brightness of the mosaic against the photograph's: median, smallest, largest
burnt    share of pixels that are white in the mosaic and not in the photograph, percent
misfit   mean absolute difference from the photograph once both have the same mean and contrast, percent of the mean
NCC      correlation with the photograph after a high-pass: what is out of place lowers it; median and tenth percentile
sharp    energy of fine detail in the mosaic against the photograph warped by a Lanczos kernel, which keeps nearly all
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.float32]

COMPARED_WIDTH_PX = 800
SHARPNESS_SIDE_PX = 384
HIGH_PASS_PX = 6.0


def main(arguments: list[str]) -> None:
    """Print one line for each mosaic."""
    print(f"{'mosaic':32} {'photos':>6} {'kept':>18} {'burnt':>7} {'misfit':>7} {'NCC':>11} {'sharp':>6}")
    for mosaic_path, report_path in zip(arguments[::2], arguments[1::2], strict=True):
        mosaic = cv2.imread(mosaic_path)
        report = json.loads(Path(report_path).read_text())
        transforms = report["mosaics"][0]["transforms"]
        photographs = (
            (straightened(cv2.imread(name), report.get("lens")), matrix) for name, matrix in transforms.items()
        )
        rows = [row for photograph, matrix in photographs if (row := measured(mosaic, photograph, np.array(matrix)))]
        kept, burnt, misfit, ncc, sharp = np.array(rows).T
        print(
            f"{Path(mosaic_path).name:32} {len(rows):6} {np.median(kept):6.2f} {kept.min():5.2f} {kept.max():5.2f}"
            f" {100 * burnt.mean():7.2f} {100 * np.median(misfit):7.1f}"
            f" {np.median(ncc):5.2f} {np.quantile(ncc, 0.1):5.2f} {np.nanmedian(sharp):6.2f}"
        )


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
