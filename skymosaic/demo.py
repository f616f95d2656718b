"""The demonstration: a rendered pair with known poses, its mosaic, and its error against the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.backends.interface import Progress, silent
from sim.scene import pair as rendered_pair
from skymosaic.errors import RegistrationError
from skymosaic.evaluation.hardware import Comparison, compare
from skymosaic.evaluation.metrics import grid_error
from skymosaic.imagery.images import save
from skymosaic.mosaicking.api import mosaic
from skymosaic.registration.options import FeatureOptions
from skymosaic.registration.pair import Pair
from skymosaic.reports.pages import make_folder
from skymosaic.reports.pair import write_pair_report
from skymosaic.stopwatch import Stopwatch

MAX_ERROR_PX = 0.5


@dataclass(frozen=True)
class Demonstration:
    """What the demonstration made.

    Attributes
    ----------
    photographs : tuple of Path
        Left and right, rendered.
    mosaic, matches, page : Path
        The mosaic, a picture of the matches, and the report's page.
    pair : Pair
    error_px : float
        Mean error of the homography over a grid of the overlap, against the known pose.
    seconds : dict of str to float
        Wall time of each stage.
    """

    photographs: tuple[Path, Path]
    mosaic: Path
    matches: Path
    page: Path
    pair: Pair
    error_px: float
    seconds: dict[str, float]


def make_demo(folder: Path, seed: int, progress: Progress = silent) -> Demonstration:
    """Render a pair, and write its mosaic and report into ``folder``.

    Raises
    ------
    RegistrationError
        If the mean homography error is not below half a pixel.
    """
    make_folder(folder)
    clock = Stopwatch()
    progress("rendering a synthetic flight")
    flight = rendered_pair(seed=seed)
    photographs = folder / "left.png", folder / "right.png"
    for path, image in zip(photographs, flight.images, strict=True):
        save(path, image)
    clock.lap("rendering")
    progress("making the mosaic")
    result = mosaic(photographs)
    pair = result.pairs[0]
    clock.lap("mosaic")
    progress("drawing")
    save(folder / "mosaic.png", result.image)
    page = write_pair_report(folder / "report", pair, np.asarray(result.image, dtype=np.uint8))
    clock.lap("drawing")
    assert pair.homography is not None  # mosaic() raises without one
    error_px = grid_error(pair.homography, flight.homography_between(0, 1), pair.left.size, pair.right.size)
    if error_px >= MAX_ERROR_PX:
        raise RegistrationError(f"mean homography error {error_px:.3f} px; below {MAX_ERROR_PX} px expected")
    return Demonstration(
        photographs, folder / "mosaic.png", page.with_name("matches.png"), page, pair, error_px, clock.seconds
    )


def compare_hardware(photographs: tuple[Path, Path], backend: str, progress: Progress = silent) -> Comparison:
    """Compare the simulated hardware with the golden model, which it has to match bit for bit.

    Raises
    ------
    RegistrationError
        If they differ.
    BackendError
        If the hardware cannot be simulated here, for instance without a compiler.
    """
    result = compare(*photographs, FeatureOptions(backend=backend), progress=progress)
    if result.mismatch:
        raise RegistrationError(f"hardware and golden model differ: {result.mismatch}")
    return result
