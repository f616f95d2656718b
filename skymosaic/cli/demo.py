"""The command that shows the whole chain on rendered photographs."""

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from golden_model.arrays import Intensities
from sim.backends.errors import BackendError
from sim.scene import make_pair
from skymosaic.cli.options import OverwriteOption, output_option
from skymosaic.cli.outputs import Writes
from skymosaic.cli.session import session
from skymosaic.common.errors import RegistrationError
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.evaluation.hardware import compare
from skymosaic.evaluation.metrics import grid_error
from skymosaic.imagery.images import check_output_folder, save
from skymosaic.mosaicking.api import mosaic
from skymosaic.registration.options import BackendOptions, PhotographOptions
from skymosaic.reports.pair import write_pair_report

MAX_ERROR_PX = 0.5
OWN_NAMES = r"(left|right|mosaic)\.png|report"
FolderOption = Annotated[Path, output_option("Folder for mosaic, pictures and report."), Writes(OWN_NAMES)]


def demo(
    *,
    output: FolderOption = Path("demo"),
    overwrite: OverwriteOption = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the rendered landscape.")] = 9,
    options: BackendOptions = BackendOptions(backend="rtl"),
) -> None:
    """Render a synthetic pair, make its mosaic, and compare it with the truth.

    The backend is compared with the golden model bit for bit, unless it is the golden model.
    """
    check_output_folder(output, overwrite=overwrite)
    output.mkdir(parents=True, exist_ok=True)
    photographs = output / "left.png", output / "right.png"
    _make_mosaic(output, photographs, seed)
    if options.backend != "golden":
        _compare_hardware(photographs, options)


def _make_mosaic(folder: Path, photographs: tuple[Path, Path], seed: int) -> None:
    """Render the pair, write its mosaic and report, and measure its homography against the known poses."""
    clock = Stopwatch()
    with session.working("demo") as step:
        step("rendering a synthetic flight")
        flight = make_pair(seed=seed)
        for path, image in zip(photographs, flight.images, strict=True):
            _save(path, image)
        clock.lap("rendering")
        step("making the mosaic")
        result = mosaic(photographs)
        clock.lap("mosaic")
        step("drawing")
        _save(folder / "mosaic.png", result.image)
        pair = result.pairs[0]
        page = write_pair_report(folder / "report", pair, np.asarray(result.image, dtype=np.uint8))
        session.wrote(page.parent)
        clock.lap("drawing")
    assert pair.homography is not None  # mosaic() raises without one
    error_px = grid_error(pair.homography, flight.homography_between(0, 1), pair.left.size, pair.right.size)
    if error_px >= MAX_ERROR_PX:
        raise RegistrationError(f"mean homography error {error_px:.3f} px; below {MAX_ERROR_PX} px expected")
    session.seconds.update(clock.seconds)
    session.numbers = {"error_px": error_px, "pair": pair.summary(), "hardware": None}
    session.show(f"features {len(pair.features[0])} and {len(pair.features[1])}, inliers {len(pair.inliers)}")
    session.show(f"mean homography error {error_px:.3f} px")
    session.show(f"photographs {photographs[0]} {photographs[1]}")
    outputs = {"mosaic": folder / "mosaic.png", "matches": page.with_name("matches.png"), "report": page}
    for name, path in outputs.items():
        session.show(f"{name:11} {path}")


def _save(path: Path, pixels: Intensities) -> None:
    save(path, pixels)
    session.wrote(path)


def _compare_hardware(photographs: tuple[Path, Path], options: BackendOptions) -> None:
    """Compare the hardware with the golden model; without a compiler, only say that it was not simulated."""
    # What was shown so far is worth seeing before a first compile, which takes a while.
    sys.stdout.flush()
    clock = Stopwatch()
    options_of_pair = PhotographOptions(backend=options.backend, address=options.address)
    try:
        with session.working("simulating the hardware") as step:
            result = compare(*photographs, options_of_pair, progress=step)
    except BackendError as error:
        session.warn(f"hardware not simulated: {error}")
        return
    if result.mismatch:
        raise RegistrationError(f"hardware and golden model differ: {result.mismatch}")
    session.seconds["hardware"] = clock.lap("hardware")
    session.numbers["hardware"] = result.summary()
    session.show(f"hardware    equal to the golden model bit for bit: {result.coverage}")
    clocks, speed = result.cycles_per_frame[0], result.cycles_per_second / 1e6
    session.show(f"            {clocks} clocks per frame, {speed:.2f} M per second")
