"""The demonstration: a rendered pair with known poses, its mosaic, and its error against the truth."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from golden_model.config import preset_config
from sim.backend import BackendError
from sim.scene import pair as rendered_pair
from skymosaic.errors import RegistrationError
from skymosaic.evaluation.hardware import compare
from skymosaic.evaluation.metrics import grid_error
from skymosaic.imagery.images import save
from skymosaic.mosaicing import mosaic
from skymosaic.registration import WORKING_WIDTH_PX
from skymosaic.reports import pair as pair_report

LARGEST_ERROR_PX = 0.5


def run_demo(folder: Path, seed: int, backend: str, console: Console) -> None:
    """Render a pair, make its mosaic and report in ``folder``, and print where they are.

    Unless ``backend`` is ``"golden"``, the pair also runs through the simulated hardware, which has to match the
    golden model bit for bit.

    Raises
    ------
    RegistrationError
        If the mean homography error is not below half a pixel, or hardware and golden model differ.
    """
    pair_report.prepare(folder)
    with console.status("rendering a synthetic flight") as status:
        flight = rendered_pair(seed=seed)
        photographs = [folder / "left.png", folder / "right.png"]
        for path, image in zip(photographs, flight.images, strict=True):
            save(path, image)
        status.update("making the mosaic")
        result = mosaic(photographs)
        pair = result.pairs[0]
        status.update("drawing")
        save(folder / "mosaic.png", result.image)
        page = pair_report.write_pair_report(folder / "report", pair, result.image)
    assert pair.homography is not None  # mosaic() raises without one
    error_px = grid_error(pair.homography, flight.homography_between(0, 1), pair.left.size, pair.right.size)
    console.print(f"features {len(pair.features[0])} and {len(pair.features[1])}, inliers {len(pair.inliers)}")
    console.print(f"mean homography error {error_px:.3f} px")
    console.print(f"photographs {photographs[0]} {photographs[1]}")
    console.print(f"mosaic      {folder / 'mosaic.png'}")
    console.print(f"matches     {folder / 'report' / 'matches.png'}")
    console.print(f"report      {page}")
    if error_px >= LARGEST_ERROR_PX:
        raise RegistrationError(f"mean homography error {error_px:.3f} px; below {LARGEST_ERROR_PX} px expected")
    if backend != "golden":
        _compare(photographs, backend, console)


def _compare(photographs: list[Path], backend: str, console: Console) -> None:
    """Compare the hardware with the golden model; without a compiler, only print that it was not simulated."""
    with console.status("simulating the hardware") as status:
        try:
            result = compare(
                *photographs,
                config=preset_config("aerial"),
                backend=backend,
                working_width_px=WORKING_WIDTH_PX,
                progress=lambda line: status.update(f"simulating the hardware: {line}"),
            )
        except BackendError as error:
            console.print(f"hardware    not simulated: {error}", markup=False)
            return
    if result.mismatch:
        raise RegistrationError(f"hardware and golden model differ: {result.mismatch}")
    console.print(f"hardware    equal to the golden model bit for bit: {result.coverage}")
    console.print(
        f"            {result.cycles_per_frame[0]} clocks a frame, {result.cycles_per_second / 1e6:.2f} M a second"
    )
