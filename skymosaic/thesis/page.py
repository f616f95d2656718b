"""The HTML page: what the thesis shows, what the same experiment gives here, and why the two differ."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from golden_model.arrays import Pixels
from golden_model.config import PRESETS
from skymosaic.common.errors import RegistrationError
from skymosaic.fuzzy.plots import draw_system
from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS
from skymosaic.imagery.notebook import data_address, jpeg_address
from skymosaic.mosaicking.api import mosaic
from skymosaic.registration.register import register
from skymosaic.reports import figures
from skymosaic.reports.pages import render
from skymosaic.thesis import charts, tables
from skymosaic.thesis.corners import CORNERS, QUALITY_TARGET, find_threshold
from skymosaic.thesis.dataset import WORKING_WIDTH_PX, DatasetPair
from skymosaic.thesis.experiments import KEY_POINTS
from skymosaic.thesis.measurements import Measurements

PICTURE_WIDTH_PX = 1200
SYSTEMS = ("correlation", "ilbp", "ransac")
"""Fuzzy systems that the page shows."""


def compose_page(m: Measurements, source: str, shown: DatasetPair) -> bytes:
    """Compose the page as one self-contained HTML file.

    ``source`` is the origin of the pairs, as text; ``shown`` is the pair of the pictures.
    """
    groups = ", ".join(f"{name} ({len(group.pairs)})" for name, group in m.groups.items())
    m = tables.scale_thresholds(m)
    return render(
        "thesis.html",
        title="The thesis's experiments, repeated",
        rows=[("pairs", f"{len(m.pairs)}: {source}"), ("groups", groups), ("images", f"{WORKING_WIDTH_PX} px at most")],
        m=m,
        tables=tables,
        charts={table: data_address(draw(m), "svg+xml") for table, draw in charts.CHARTS.items()},
        corners=CORNERS,
        key_points=KEY_POINTS,
        quality_target=f"{QUALITY_TARGET:.0%}",
        systems=[
            (system.title, data_address(draw_system(system), "png"))
            for system in (PLOTTED_SYSTEMS[name] for name in SYSTEMS)
        ],
        pair=shown.name,
        pictures=[(caption, jpeg_address(picture, PICTURE_WIDTH_PX)) for caption, picture in draw_pair(shown)],
    )


def draw_pair(pair: DatasetPair) -> Iterator[tuple[str, Pixels]]:
    """Draw the pictures, each with its caption."""
    sides = pair.left, pair.right
    thesis, threshold = PRESETS["thesis"], max(map(find_threshold, pair.grays))
    thesis = dataclasses.replace(thesis, front_end=dataclasses.replace(thesis.front_end, threshold=threshold))
    ilbp = register(*sides, config=thesis)
    yield "Harris corners of the thesis preset, left image", figures.draw_corners(ilbp.working[0], ilbp.features[0])
    yield "Harris corners of the thesis preset, right image", figures.draw_corners(ilbp.working[1], ilbp.features[1])
    windows = register(*sides, config=thesis, detector="harris", descriptor="window-10")
    yield "1. Fuzzy correlation, SAD of 10x10 windows: good matches are kept", figures.draw_matches(windows)
    yield "2. Fuzzy ILBP, four rings", figures.draw_matches(ilbp)
    sift = register(*sides, detector="sift", descriptor="thesis-ilbp-4", estimator="fuzzy-ransac")
    yield "3. Fuzzy RANSAC, SIFT + ILBP: kept are the matches that the six rules accept", figures.draw_matches(sift)
    yield "The aerial preset's eight rules", figures.draw_matches(register(*sides))
    try:
        yield "Mosaic by the aerial preset", np.asarray(mosaic(sides).image, dtype=np.uint8)
    except RegistrationError:
        return
