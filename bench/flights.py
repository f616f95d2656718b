"""Whole flights: what is placed, how exactly, how the mosaics look, and what it costs.

    python -m bench.flights peers FLIGHT ...
    python -m bench.flights rendered [NAME ...]
    python -m bench.flights quality FLIGHT ...
    python -m bench.flights maps FLIGHT ...
    python -m bench.flights errors FLIGHT ...
    python -m bench.flights nuisances [NAME ...]

A FLIGHT is a folder of photographs, or the name of a public flight below SKYMOSAIC_DATA, such as ``brighton_beach``.
"""

from pathlib import Path

import numpy as np

from bench.independent_ties import errors
from bench.mosaic_quality import quality
from bench.nuisances import nuisances
from bench.rendered_flights import rendered
from bench.report import Flights, JsonFile, Row, program, public_folder, report
from bench.stitcher_runs import peers
from golden_model.arrays import Points
from skymosaic.flight.mapping.cameras import cameras_of
from skymosaic.flight.mapping.place import tolerance_m
from skymosaic.geometry.homography import DegenerateError, apply, estimate_similarity
from skymosaic.maps.georeference import fit_to_map, project_to_utm
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions

app = program(__doc__)
for command in (peers, rendered, quality, errors, nuisances):
    app.command()(command)


@app.command()
def maps(flights: Flights, json_file: JsonFile = None) -> None:
    """How well flights fit their GPS: at the middle of the photographs, and at the positions of the cameras.

    Median and root mean square distance of all positions, so that both fits are judged alike.
    """
    report("distance from GPS", [gps_row(public_folder(flight)) for flight in flights], json_file)


def gps_row(folder: Path) -> Row:
    """A flight's spread of GPS positions, and the residuals of both fits."""
    with open_plan([folder], MosaicOptions()) as plan:
        flight, layout = plan.flight, plan.layouts[0]
    members = [member for member in layout.members if flight.views[member].gps is not None]
    transforms = layout.to_reference(flight.views)
    centres = np.array([apply(transforms[m], (np.array(flight.views[m].size) - 1) / 2) for m in members])
    placed = dict(zip(layout.members, cameras_of(flight, layout), strict=True))
    cameras = np.array([placed[member].position[:2] for member in members])
    crs, metres = project_to_utm([gps for m in members if (gps := flight.views[m].gps) is not None])
    spread = np.sqrt(np.mean(np.sum((metres - metres.mean(axis=0)) ** 2, axis=1)))
    tolerances_m = np.array([tolerance_m(flight.views[member].taken.accuracy_m) for member in members])
    fit, _ = fit_to_map(cameras, metres, crs, tolerances_m=tolerances_m)
    return {
        "flight": f"{folder.name}, {len(layout.members)} photographs",
        "GPS spread": f"{spread:.0f} m",
        "at image centres, median / RMS": residuals(centres, metres),
        "at cameras, median / RMS": residuals(cameras, metres),
        "positions left out": "all: refused" if fit is None else f"{len(fit.disagreeing)} of {len(members)}",
    }


def residuals(places: Points, metres: Points) -> str:
    """Median and root mean square distance after the best similarity, in words."""
    upright = places * [1.0, -1.0]
    try:
        offsets = np.linalg.norm(apply(estimate_similarity(upright, metres), upright) - metres, axis=1)
    except DegenerateError:
        return "none"
    return f"{np.median(offsets):.2f} / {np.sqrt(np.mean(offsets**2)):.2f} m"


if __name__ == "__main__":
    app()
