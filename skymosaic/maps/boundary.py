"""The area at which a map ends: polygons of a GeoJSON or KML file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as XmlTree

import numpy as np
import rasterio.features
from rasterio import Affine

from golden_model.arrays import Array, Mask, Points
from golden_model.small_files import read_small_file
from skymosaic.common.errors import InputError, reading
from skymosaic.imagery.exif import Position
from skymosaic.maps.control_points import MAX_BYTES, convert_to_degrees, read_system
from skymosaic.maps.georeference import reproject

CELLS = 4000
"""Cells along the longer side of the area, by which it is measured."""
PARTS = 16
"""Into which an edge is cut before it is converted: then one of a kilometre keeps its place within 0.1 mm."""


class OutsideError(InputError):
    """A mosaic shows nothing of the area."""


@dataclass(frozen=True, eq=False)
class Boundary:
    """An area, which may have holes and several parts."""

    name: str
    """Name of the file, for messages."""
    crs: str
    polygons: tuple[tuple[Points, ...], ...]
    """The rings of each, x first, (N, 2), whose last point is the first: the outer one, then the holes."""

    @property
    def points(self) -> Points:
        """The corners of its outer rings."""
        return np.concatenate([rings[0] for rings in self.polygons])

    def in_system(self, crs: str) -> Boundary:
        """The same area in another coordinate system, where straight edges may be curves."""
        if crs == self.crs:
            return self
        steps = np.linspace(0, 1, PARTS, endpoint=False)[:, None]

        def convert(ring: Points) -> Points:
            fine = (ring[:-1, None] + steps * np.diff(ring, axis=0)[:, None]).reshape(-1, 2)
            return reproject(np.concatenate([fine, ring[-1:]]), self.crs, crs)

        return Boundary(self.name, crs, tuple(tuple(map(convert, rings)) for rings in self.polygons))

    def mask(self, shape: tuple[int, ...], transform: Affine) -> Mask:
        """Which pixels have their centre inside, (H, W), as GDAL's cutline; ``transform`` is that of a raster."""
        # GDAL fills by even and odd: a hole outside its polygon would be area.
        outer = _burn([rings[:1] for rings in self.polygons], shape, transform)
        return outer & _burn(self.polygons, shape, transform)

    def share_shown(self, outlines: Sequence[Points]) -> float:
        """Which share of it outlines of photographs (N, 2) cover; both are in one system in metres.

        Raises
        ------
        OutsideError
            If they cover none of it.
        """
        (west, south), (width, height) = self.points.min(axis=0), np.ptp(self.points, axis=0)
        cell = max(width, height, 1e-6) / CELLS
        grid = (int(height / cell) + 1, int(width / cell) + 1), Affine(cell, 0, west, 0, cell, south)
        inside, covered = self.mask(*grid), burn_outlines(outlines, *grid)
        if not (inside & covered).any():
            raise OutsideError(f"{self.name}: no photograph shows any of it; check the area and its coordinate system")
        return float(covered[inside].mean())

    @cached_property
    def _box_degrees(self) -> tuple[Array, Array]:
        degrees = self.in_system("EPSG:4326").points
        return degrees.min(axis=0), degrees.max(axis=0)

    def metres_to(self, place: Position) -> float:
        """About how far a place is from the area."""
        longitude, latitude = np.clip(place.degrees, *self._box_degrees).tolist()
        return float(np.hypot(*place.metres_from(Position(latitude, longitude))))


def burn_outlines(outlines: Sequence[Points], shape: tuple[int, ...], transform: Affine) -> Mask:
    """Which pixels of a raster have their centre in any of the outlines (N, 2), not closed, in its system, (H, W)."""
    return _burn([[ring[[*range(len(ring)), 0]]] for ring in outlines], shape, transform)


def _burn(polygons: Sequence[Sequence[Points]], shape: tuple[int, ...], transform: Affine) -> Mask:
    shapes = ({"type": "Polygon", "coordinates": [ring.tolist() for ring in rings]} for rings in polygons)
    return np.asarray(rasterio.features.rasterize(shapes, shape, transform=transform, dtype="uint8"), np.bool_)


def load_boundary(path: Path) -> Boundary:
    """Read the polygons of a ``.geojson`` or ``.kml`` file.

    Raises
    ------
    InputError
        For a file of another kind, one without polygons, an unknown coordinate system, or a polygon that crosses
        itself.
    """
    read = {".geojson": _read_geojson, ".json": _read_geojson, ".kml": _read_kml}.get(path.suffix.lower())
    if read is None:
        # A GeoPackage is a database of binary geometries, for which no library is installed.
        raise InputError(f"{path}: a boundary is read from .geojson and .kml files; convert it, with QGIS or ogr2ogr")
    with reading(path, "give a GeoJSON or KML file"):
        data = read_small_file(path, MAX_BYTES)
    try:
        name, found = read(data)
        polygons = tuple(_close_all(rings) for rings in found)
    # Whatever it is that the file has in place of numbers, names and lists.
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError, XmlTree.ParseError) as error:
        raise InputError(f"{path}: is no {path.suffix[1:]} file of polygons ({error}); export it again") from None
    if not polygons:
        raise InputError(f"{path}: has no polygon; draw the area as one, not as a line or a point")
    crs = read_system(path, name)
    for rings in polygons:
        convert_to_degrees(path, crs, np.concatenate(rings))
        if (place := _find_crossing(rings)) is not None:
            raise InputError(f"{path}: a polygon crosses itself near {place[0]:.8g}, {place[1]:.8g}; draw it anew")
    return Boundary(str(path), crs.to_string(), polygons)


def _close_all(rings: Any) -> tuple[Points, ...]:
    if not rings:
        raise ValueError("a polygon has no outer ring")
    return tuple(map(_close, rings))


def _close(points: Any) -> Points:
    """A ring as an array, closed."""
    ring = np.array([[float(x) for x in point[:2]] for point in points], np.float64)
    if len(ring) < 3 or ring.shape[1] != 2 or not np.isfinite(ring).all():
        raise ValueError("a ring has at least three corners, of two numbers each")
    return ring if (ring[0] == ring[-1]).all() else np.concatenate([ring, ring[:1]])


def _read_geojson(data: bytes) -> tuple[str, list[Any]]:
    """The name of the coordinate system, and the rings of all polygons."""

    def find(value: Any) -> Iterator[Any]:
        kind = value.get("type") if isinstance(value, dict) else None
        if kind in ("Polygon", "MultiPolygon"):
            yield from [value["coordinates"]] if kind == "Polygon" else value["coordinates"]
        else:
            for each in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
                yield from find(each)

    whole = json.loads(data)
    # Left out of the format in 2016, and still written for all but degrees on WGS 84.
    named = whole.get("crs")
    return named["properties"]["name"] if named else "EPSG:4326", list(find(whole))


def _read_kml(data: bytes) -> tuple[str, list[Any]]:
    """The same; corners are longitudes, latitudes and heights with commas between them."""
    polygons = []
    for polygon in XmlTree.fromstring(data).findall(".//{*}Polygon"):
        outer, inner = (polygon.findall(f"{{*}}{side}BoundaryIs//{{*}}coordinates") for side in ("outer", "inner"))
        rings = [*outer[:1], *inner] if outer else []
        polygons.append([[c.split(",") for c in (ring.text or "").split()] for ring in rings])
    return "EPSG:4326", polygons


def _find_crossing(rings: Sequence[Points]) -> Points | None:
    """A corner near which two edges of some rings cross, x and y; None without."""
    edges = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])
    edges = edges[np.argsort(edges[..., 0].min(axis=1))]
    left, right = edges[..., 0].min(axis=1), edges[..., 0].max(axis=1)

    def across(a: Array, b: Array, ends: Array) -> Mask:
        """Whether the two ends lie on different sides of the line from a to b."""
        one, other = np.expand_dims(b - a, -2), ends - np.expand_dims(a, -2)
        return np.asarray(np.prod(np.sign(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]), axis=-1) < 0)

    for index, edge in enumerate(edges):
        # From left to right: those behind it that begin before it ends.
        near = edges[index + 1 : int(np.searchsorted(left, right[index], side="right"))]
        crossing = near[across(edge[0], edge[1], near) & across(near[:, 0], near[:, 1], edge)]
        if len(crossing):
            return np.asarray(crossing[0, 0])
    return None
