"""What a lens costs: position errors of rendered flights through a lens and in uneven light, with and without a camera
file.

    python bench/lens.py [--seeds N] [--images N] [--width PX]

The same flights are rendered without and with distortion (k1 -0.1), and without and with uneven light: corners that are
35 % darker, exposure drifting by 6 %, white balance by 3 %. With a camera file, photographs are straightened before
features are found; without one, features are found in the bent photographs, and k1 is estimated from them. The
photographs are laid out, not blended. Errors are those of ``bench/sequence.py --rendered``, averaged over the seeds.
"""

from __future__ import annotations

from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from golden_model.config import preset_config
from sequence import JPEG_QUALITY, position_errors
from sim.scene import make_lawnmower
from sim.scene.flight import Flight
from skymosaic.flight.cache import ResultCache
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.survey import survey
from skymosaic.flight.workers import Workers
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import list_sources

LENS: dict[str, Any] = {"k1": -0.1}
LIGHT: dict[str, Any] = {"vignetting": 0.35, "exposure_step": 0.06, "balance_sigma": 0.03}
FLIGHTS: dict[str, tuple[dict[str, Any], bool]] = {
    "no distortion": ({}, False),
    "uneven light": (LIGHT, False),
    "lens": (LENS, False),
    "lens, camera file": (LENS, True),
    "lens and uneven light": (LENS | LIGHT, False),
    "lens and uneven light, camera file": (LENS | LIGHT, True),
}
"""How each flight is rendered, and whether its lens is known."""


def measured(truth: Flight, *, known: bool) -> tuple[float, float]:
    """Mean position error, and median error of the ties, px."""
    photographs = []
    for image in truth.images:
        _, file = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
        photographs.append(np.asarray(cv2.imdecode(file, cv2.IMREAD_COLOR), dtype=np.uint8))
    camera = truth.camera
    distortion = np.array([camera.k1, 0, 0, 0, 0])
    lens = Lens((camera.width_px, camera.height_px), camera.matrix, distortion) if known else Lens()
    settings = Settings(preset_config("aerial"), lens=lens)
    with Workers() as workers:
        flight = survey(list_sources(photographs), settings, 0, workers, ResultCache(None))
    layout = flight.layouts[0]
    transforms = {str(member): matrix for member, matrix in layout.to_reference(flight.views).items()}
    errors_px, _ = position_errors(transforms, truth, [str(index) for index in range(len(photographs))])
    return float(errors_px.mean()), layout.median_error_px


def main(
    seeds: Annotated[int, typer.Option(min=1, help="Flights of each kind.")] = 4,
    images: Annotated[int, typer.Option(min=6, help="Of each flight.")] = 30,
    width_px: Annotated[int, typer.Option("--width", help="Of the photographs; 4:3.")] = 640,
) -> None:
    """Print the table."""
    table = Table("flight", "position error, px (each seed)", "median error of ties, px")
    size = (width_px, width_px * 3 // 4)
    for name, (how, known) in track(FLIGHTS.items(), console=Console(stderr=True)):
        flights = (make_lawnmower(seed, images, size, side_overlap=0.5, **how) for seed in range(1, seeds + 1))
        errors, ties = np.array([measured(flight, known=known) for flight in flights]).T
        each = ", ".join(f"{error:.3f}" for error in errors)
        table.add_row(name, f"{errors.mean():.3f} ({each})", f"{ties.mean():.2f}")
    Console().print(table)


if __name__ == "__main__":
    typer.run(main)
