"""The HTML page: what the thesis shows, what the same experiment gives here, and why the two differ."""

import base64
from collections import Counter
from collections.abc import Iterable

from golden_model.arrays import Pixels
from skymosaic.fuzzy.plots import draw_system
from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS
from skymosaic.imagery.notebook import jpeg_address
from skymosaic.reports.pages import render
from skymosaic.thesis import charts, tables
from skymosaic.thesis.corners import CORNERS, QUALITY_TARGET
from skymosaic.thesis.dataset import WORKING_WIDTH_PX
from skymosaic.thesis.measurements import Measurements
from skymosaic.thesis.rejection import KEY_POINTS

PICTURE_WIDTH_PX = 1200
SYSTEMS = ("correlation", "ilbp", "ransac")
"""Fuzzy systems that the page shows."""


def compose_page(m: Measurements, source: str, pictures: Iterable[tuple[str, Pixels]], pair: str) -> bytes:
    """Compose the page as one self-contained HTML file.

    ``source`` is the origin of the pairs, as text; ``pictures`` are captions and pictures of the one that is named.
    """
    pairs = Counter(group for _, group in {(line.pair, line.group) for line in m.lines})
    groups = ", ".join(f"{group} ({pairs[group]})" for group in m.groups)
    return render(
        "thesis.html",
        title="The thesis's experiments, repeated",
        rows=[("pairs", f"{len(m.pairs)}: {source}"), ("groups", groups), ("images", f"{WORKING_WIDTH_PX} px at most")],
        m=m,
        tables=tables,
        charts=charts,
        embed=_embed,
        corners=CORNERS,
        key_points=KEY_POINTS,
        quality_target=f"{QUALITY_TARGET:.0%}",
        systems=[
            (system.title, _embed(draw_system(system), "png")) for system in (PLOTTED_SYSTEMS[name] for name in SYSTEMS)
        ],
        pair=pair,
        pictures=[(caption, jpeg_address(picture, PICTURE_WIDTH_PX)) for caption, picture in pictures],
    )


def _embed(picture: bytes, kind: str) -> str:
    """Turn a picture into a data URL, so that the page needs no other file."""
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"
