"""Where a flight has to be flown again: holes of the area, weak links, and photographs that were left out."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
import rasterio.features
from rasterio import Affine

from golden_model.arrays import Points
from skymosaic.common.errors import InputError
from skymosaic.flight.checking.check import weak_parts
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.extent import outline
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.mapping.place import place_on_map
from skymosaic.geometry.homography import apply
from skymosaic.maps.boundary import Boundary, burn_outlines
from skymosaic.maps.control_points import ControlPoints
from skymosaic.maps.features import Place
from skymosaic.maps.georeference import Georeference, map_to_globe, reproject

CELLS, MAX_CELLS = 200, 4000
"""Cells in which holes are found, along the side of a photograph on the ground; and at most along that of the area."""
REACH = 1.25
"""A gap between photographs is a hole up to this many sides of a photograph; a wider one may be meant."""
THINNEST, SMALLEST = 0.06, 0.01
"""Gaps thinner than this share of a side, or smaller than this share of a photograph, are no holes: borders of
neighbours are never quite in line."""


def plan_again(
    flight: Flight, control: ControlPoints | None = None, boundary: Boundary | None = None
) -> tuple[list[Place], float]:
    """What has to be flown again, as places on the globe, and which share of a boundary's area is shown.

    Raises
    ------
    InputError
        If no part of the flight has a place on the map, or the boundary is elsewhere.
    """
    placed = list(_place(flight, control))
    if not placed:
        raise InputError("no part of the flight has a place on the map, so nothing says where to fly again")
    names = flight.view_names
    places = []
    crs = placed[0][1].crs
    outlines = [_outlines(flight, layout, on_map, crs) for layout, on_map in placed]
    area = None if boundary is None else boundary.in_system(crs)
    rings = [ring for each in outlines for ring in each.values()]
    for number, (ring, area_m2) in enumerate(find_holes(rings, area), start=1):
        places.append(Place(f"hole {number}", "Polygon", map_to_globe(ring, crs), {"area_m2": round(area_m2, 2)}))
    for (layout, _), shown in zip(placed, outlines, strict=True):
        middles = {view: ring.mean(axis=0) for view, ring in shown.items()}
        for _, _, link, overlap in weak_parts(flight, layout):
            ends = map_to_globe(np.array([middles[link.left], middles[link.right]]), crs)
            name = f"weak link {names[link.left]} - {names[link.right]}"
            places.append(Place(name, "LineString", ends, {"matches": link.ties, "overlap": round(overlap, 3)}))
    for source, view, name in zip(flight.sources, flight.views, names, strict=True):
        if source.index in flight.left_out and view.gps is not None:
            degrees, reason = np.array([view.gps.degrees]), flight.shorten(flight.left_out[source.index])
            places.append(Place(f"left out {name}", "Point", degrees, {"reason": reason}))
    return places, 1.0 if area is None else area.share_shown(rings)


def _place(flight: Flight, control: ControlPoints | None) -> Iterator[tuple[Layout, Georeference]]:
    """The layouts that have a place on the map, each with that of its ground pixels."""
    for layout in flight.layouts:
        try:
            on_map = place_on_map(flight, layout, control).georeference
        # The control points do not reach this group.
        except InputError:
            continue
        if on_map is not None:
            yield layout, on_map.for_pixels(flight.views[layout.reference].to_original)


def _outlines(flight: Flight, layout: Layout, on_map: Georeference, crs: str) -> dict[int, Points]:
    """Corners of what each photograph of a layout shows, metres on one map."""
    views = {member: outline(flight.views[member], layout.transforms[member]) for member in layout.members}
    return {view: reproject(apply(on_map.to_map, corners), on_map.crs, crs) for view, corners in views.items()}


def find_holes(outlines: Sequence[Points], area: Boundary | None = None) -> list[tuple[Points, float]]:
    """Find what photographs leave out between them, or of an area, by the corners (N, 2) of what each shows, m.

    Returns the closed ring (N, 2) of each hole, m, counter-clockwise, and its area, m²; the largest first.
    """
    side_m = float(np.median([np.sqrt(cv2.contourArea(np.float32(ring - ring[0]))) for ring in outlines]))
    # Photographs lie along the strips, and gaps between strips are rectangles in that direction.
    edges = np.concatenate([np.diff(ring, axis=0) @ [1, 1j] for ring in outlines])
    turn = np.angle(np.sum(np.abs(edges) * np.exp(4j * np.angle(edges)))) / 4
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    turned = np.concatenate([*outlines, *([] if area is None else [area.points])]) @ axes
    low, extent = turned.min(axis=0) - REACH * side_m, np.ptp(turned, axis=0) + 2 * REACH * side_m
    cell_m = max(side_m / CELLS, extent.max() / MAX_CELLS)
    to_map = Affine(*np.column_stack((axes * cell_m, axes @ low)).ravel())
    shape = tuple(int(np.ceil(length / cell_m)) for length in extent[::-1])
    covered = burn_outlines(outlines, shape, to_map).astype(np.uint8)
    reach, thinnest = (np.ones((max(round(share * side_m / cell_m), 1),) * 2, np.uint8) for share in (REACH, THINNEST))
    wanted = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, reach) if area is None else area.mask(shape, to_map)
    lacking = wanted.astype(np.uint8) & ~covered & 1
    lacking = cv2.morphologyEx(lacking, cv2.MORPH_OPEN, thinnest)
    holes = []
    for geometry, _ in rasterio.features.shapes(lacking, mask=lacking > 0, transform=to_map):
        ring = np.array(geometry["coordinates"][0])
        area_m2 = float(np.sum(ring[:-1, 0] * ring[1:, 1] - ring[1:, 0] * ring[:-1, 1])) / 2
        if abs(area_m2) >= SMALLEST * side_m**2:
            holes.append((ring if area_m2 > 0 else ring[::-1], abs(area_m2)))
    return sorted(holes, key=lambda hole: -hole[1])
