"""One stitcher on one folder of photographs, in a process of its own; prints what it reached as a JSON line.

    python bench/stitchers.py METHOD FOLDER WORKING_WIDTH MEMORY_GB

METHOD is skymosaic, opencv (`cv2.Stitcher` SCANS), openstitching or openstitching-sift (the package `stitching` in
affine mode, with its own 500 ORB features or with 2000 SIFT features). Each imports only what it needs: the package
`stitching` runs in an environment of its own.
"""

import importlib
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np

SUFFIXES = (".jpg", ".jpeg", ".png")
Result = dict[str, Any]


def skymosaic(package: ModuleType, paths: Sequence[str], width_px: int, result: Result) -> None:
    """This project, without what earlier runs of it kept."""
    with tempfile.TemporaryDirectory() as cache:
        mosaic = package.mosaic(paths, working_width_px=width_px, canvas_limit_px=10**9, cache=Path(cache))
    result["transforms"] = {Path(paths[index]).name: mosaic.transforms[index].tolist() for index in mosaic.placed}
    # As k1 over the square of the focal length, because tie points do not determine the focal length.
    numbers = mosaic.flight.lens.numbers
    result["distortion"] = numbers["k1"] / numbers["focal_x_px"] ** 2 if numbers else 0.0


def opencv(package: ModuleType, paths: Sequence[str], width_px: int, result: Result) -> None:
    """OpenCV's stitcher for scans."""
    images = [cv2.imread(path) for path in paths]
    stitcher = package.Stitcher_create(package.Stitcher_SCANS)
    stitcher.setRegistrationResol(_megapixels(images[0], width_px))
    if stitcher.estimateTransform(images) != cv2.Stitcher_OK:
        raise RuntimeError("no transformations")
    names = [Path(paths[index]).name for index in stitcher.component()]
    result["transforms"] = _as_warped(names, stitcher.cameras(), stitcher.workScale())
    if stitcher.composePanorama()[0] != cv2.Stitcher_OK:
        raise RuntimeError("no panorama")


def openstitching(
    package: ModuleType, paths: Sequence[str], width_px: int, result: Result, *, detector: str = "orb", count: int = 500
) -> None:
    """The package `stitching`."""
    resolution = package.images.Images.Resolution

    class Observed(package.AffineStitcher):
        def estimate_scale(self, cameras: Any) -> None:
            scale = self.images.get_ratio(resolution.FINAL, resolution.MEDIUM)
            result["transforms"] = _as_warped([Path(name).name for name in self.images.names], cameras, scale)
            super().estimate_scale(cameras)

    megapixels = _megapixels(cv2.imread(paths[0]), width_px)
    Observed(crop=False, medium_megapix=megapixels, detector=detector, nfeatures=count).stitch(list(paths))


METHODS: dict[str, tuple[str, Callable[..., None]]] = {
    "skymosaic": ("skymosaic", skymosaic),
    "opencv": ("cv2", opencv),
    "openstitching": ("stitching", openstitching),
    "openstitching-sift": ("stitching", partial(openstitching, detector="sift", count=2000)),
}
"""The package each needs, and what runs it."""


def _megapixels(image: np.ndarray, width_px: int) -> float:
    height, width = image.shape[:2]
    return min(width_px, width) ** 2 * height / width / 1e6


def _as_warped(names: Sequence[str], cameras: Sequence[Any], scale: float) -> dict[str, list[list[float]]]:
    """Original pixels to the mosaic's, as OpenCV's affine warper applies a camera: by the transpose, p = A'(x - t)."""
    transforms = {}
    for name, camera in zip(names, cameras, strict=True):
        affine = np.asarray(camera.R, dtype=np.float64)
        turned = affine[:2, :2].T
        matrix = np.eye(3)
        matrix[:2] = np.column_stack([turned * scale, -turned @ affine[:2, 2]])
        transforms[name] = matrix.tolist()
    return transforms


def main(method: str, folder: str, width_px: str, memory_gb: str) -> None:
    """Run one method; a failure is part of its result."""
    resource.setrlimit(resource.RLIMIT_AS, (int(float(memory_gb) * 2**30),) * 2)
    paths = sorted(str(path) for path in Path(folder).iterdir() if path.suffix.lower() in SUFFIXES)
    result: Result = {"transforms": {}, "failure": ""}
    package, stitch = METHODS[method]
    imported = importlib.import_module(package)
    start = time.process_time()
    try:
        stitch(imported, paths, int(width_px), result)
    except Exception as error:
        result["failure"] = " ".join(str(error).split()) or type(error).__name__
    result["cpu_seconds"] = time.process_time() - start
    result["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sys.stdout.write("\n" + json.dumps(result) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
