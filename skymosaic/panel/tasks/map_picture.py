"""The picture of a georeferenced mosaic for the page's map, made in a worker."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import save_bytes
from skymosaic.maps.georeference import Georeference, map_to_globe, reproject
from skymosaic.panel.pair_view import Size
from skymosaic.panel.results import MapView

WEB_MERCATOR = "EPSG:3857"
LONGEST_SIDE_PX = 2000
METRES_A_DEGREE = 111_320.0
"""Of latitude."""
LINES_ACROSS = 10
"""About as many grid lines cross the mosaic."""


def map_view(preview: Pixels, size: Size, position: Georeference, outlines: dict[str, Array], picture: Path) -> MapView:
    """Draw a mosaic in the projection of web maps, and place the outlines of its photographs there.

    The four corners are projected and the picture between them is mapped by a homography: over the few kilometres of a
    flight, the projections differ from that by less than a pixel of the page.

    Parameters
    ----------
    preview : (h, w, 3) or (h, w) uint8 ndarray
        The mosaic, reduced; what is black shows no ground.
    size : (int, int)
        Of the whole mosaic, px.
    position : Georeference
        Of the whole mosaic.
    outlines : dict of str to (4, 2) ndarray
        Corners of the photographs in pixels of the whole mosaic, by name.
    picture : Path
        PNG to write.
    """
    colour = preview if preview.ndim == 3 else cv2.cvtColor(preview, cv2.COLOR_GRAY2BGR)
    frame = np.array([(0, 0), (size[0], 0), size, (0, size[1])]) - 0.5
    corners_m = reproject(apply(position.to_map, frame), position.crs, WEB_MERCATOR)
    (west, south), (east, north) = corners_m.min(axis=0), corners_m.max(axis=0)
    metres_per_pixel = max(east - west, north - south) / min(LONGEST_SIDE_PX, max(preview.shape))
    width, height = (math.ceil(extent / metres_per_pixel) for extent in (east - west, north - south))
    source = (frame + 0.5) * (preview.shape[1] / size[0], preview.shape[0] / size[1]) - 0.5
    target = (corners_m - (west, north)) * (1, -1) / metres_per_pixel - 0.5
    to_picture = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    opaque = np.where(colour.any(axis=2), 255, 0).astype(np.uint8)
    warped = cv2.warpPerspective(np.dstack([colour, opaque]), to_picture, (width, height))
    save_bytes(picture, cv2.imencode(".png", warped)[1].tobytes())
    edges_m = np.array([(west, north - height * metres_per_pixel), (west + width * metres_per_pixel, north)])
    (left, bottom), (right, top) = map_to_globe(edges_m, WEB_MERCATOR).tolist()
    placed = {
        name: [(y, x) for x, y in map_to_globe(apply(position.to_map, corners), position.crs).tolist()]
        for name, corners in outlines.items()
    }
    return MapView(picture, (bottom, left, top, right), placed, position.crs, _grid_step_m(right - left))


def _grid_step_m(width_deg: float) -> float:
    """Distance of the grid's lines: 1, 2 or 5 times a power of ten."""
    wanted = max(width_deg * METRES_A_DEGREE / LINES_ACROSS, 1e-3)
    power = 10.0 ** math.floor(math.log10(wanted))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= wanted)
