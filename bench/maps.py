"""How well flights fit their GPS: fitted at the middle of the photographs, and at the positions of the cameras.

    python bench/maps.py FOLDER ... [--working-width 1280] [--cache FOLDER]

A folder is a path, or the name of a public flight. Prints a row for each flight: the spread of the GPS positions, the
median and the root mean square distance of all of them from both fits, and the photographs that the fit at the
cameras leaves out. The residuals are of all positions, so that both fits are judged alike.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from golden_model.arrays import Points
from skymosaic.flight.picture.mapping import camera_positions
from skymosaic.geometry.homography import DegenerateError, apply, estimate
from skymosaic.maps.georeference import fit_to_map, project_to_utm
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.registration.options import WORKING_WIDTH_PX

DATA = Path(os.environ.get("SKYMOSAIC_DATA", Path(__file__).parents[2] / "shared" / "data")) / "flights"


def residuals_m(places: Points, metres: Points) -> str:
    """Median and root mean square distance after the best similarity, in words."""
    upright = places * [1.0, -1.0]
    try:
        offsets = np.linalg.norm(apply(estimate(upright, metres, model="similarity"), upright) - metres, axis=1)
    except DegenerateError:
        return "none"
    return f"{np.median(offsets):.2f} / {np.sqrt(np.mean(offsets**2)):.2f} m"


def main(
    folders: list[str],
    working_width: Annotated[int, typer.Option()] = WORKING_WIDTH_PX,
    cache: Annotated[Path | None, typer.Option()] = None,
) -> None:
    """Print the table."""
    print("| flight | GPS spread | at image centres, median / RMS | at cameras, median / RMS | left out |")
    print("|---|---|---|---|---|")
    for folder in folders:
        path = Path(folder) if Path(folder).is_dir() else DATA / folder
        with open_plan([path], MosaicOptions(working_width_px=working_width, cache=cache)) as plan:
            flight, layout = plan.flight, plan.layouts[0]
        members = [member for member in layout.members if flight.views[member].gps is not None]
        transforms = layout.to_reference(flight.views)
        centres = np.array([apply(transforms[m], (np.array(flight.views[m].size) - 1) / 2) for m in members])
        cameras = camera_positions(flight, layout)[[layout.members.index(m) for m in members], :2]
        crs, metres = project_to_utm([gps for m in members if (gps := flight.views[m].gps) is not None])
        spread = np.sqrt(np.mean(np.sum((metres - metres.mean(axis=0)) ** 2, axis=1)))
        found, reason = fit_to_map(cameras, metres, crs)
        out = reason if found is None else f"{len(found.disagreeing)} of {len(members)}"
        print(
            f"| {path.name}, {len(layout.members)} photographs | {spread:.0f} m | {residuals_m(centres, metres)} "
            f"| {residuals_m(cameras, metres)} | {out} |"
        )


if __name__ == "__main__":
    typer.run(main)
