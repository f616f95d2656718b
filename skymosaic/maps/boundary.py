"""The area at which a map ends: polygons of a GeoJSON or KML file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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

HECTARE_M2 = 10_000
CELLS = 4000
"""Cells along the longer side of the area, by which it is measured."""
PARTS = 16
"""Into which an edge is cut before it is converted: then one of a kilometre keeps its place within 0.1 mm."""
_KML_RING = "{*}LinearRing/{*}coordinates"


@dataclass(frozen=True)
class Cover:
    """How much of an area photographs show."""

    file: str
    area_m2: float
    shown: float
    """Share of it."""

    @property
    def description(self) -> str:
        """All of it in a line."""
        return f"photographs show {self.shown:.1%} of the {spell_area(self.area_m2)} of {self.file}"


def spell_area(area_m2: float) -> str:
    """An area in words, in hectares from one on."""
    hectares = area_m2 / HECTARE_M2
    return f"{hectares:.2f} ha" if hectares >= 1 else f"{area_m2:.0f} m²"


@dataclass(frozen=True, eq=False)
class Boundary:
    """An area, which may have holes and several parts."""

    name: str
    """Name of the file, for messages."""
    crs: str
    polygons: tuple[tuple[Points, ...], ...]
    """The rings of each, x first, (N, 2), whose last point is the first: the outer one, then the holes."""

    @property
    def rings(self) -> list[Points]:
        """Those of all polygons."""
        return [ring for rings in self.polygons for ring in rings]

    @property
    def box(self) -> Array:
        """The lowest and the highest x and y, (2, 2)."""
        points = np.concatenate(self.rings)
        return np.array([points.min(axis=0), points.max(axis=0)])

    def in_system(self, crs: str) -> Boundary:
        """The same area in another coordinate system, where straight edges may be curves."""
        if crs == self.crs:
            return self
        steps = np.linspace(0, 1, PARTS, endpoint=False)[:, None]

        def convert(ring: Points) -> Points:
            fine = (ring[:-1, None] + steps * np.diff(ring, axis=0)[:, None]).reshape(-1, 2)
            return reproject(np.concatenate([fine, ring[-1:]]), self.crs, crs)

        return Boundary(self.name, crs, tuple(tuple(map(convert, rings)) for rings in self.polygons))

    def mask(self, shape: tuple[int, int], transform: Affine) -> Mask:
        """Which pixels have their centre inside, (H, W), as GDAL's cutline; ``transform`` is that of a raster."""
        return _burn(self.polygons, shape, transform)

    def measure(self, outlines: Sequence[Points]) -> Cover:
        """How much of it outlines of photographs (N, 2) cover; both are in one system in metres.

        Raises
        ------
        InputError
            If they cover none of it.
        """
        low, extent = self.box[0], np.ptp(self.box, axis=0)
        cell_m = max(float(extent.max()) / CELLS, 1e-6)
        grid = tuple(np.ceil(extent[::-1] / cell_m).astype(int)), Affine(cell_m, 0, low[0], 0, cell_m, low[1])
        inside = self.mask(*grid)
        covered = inside & _burn([[np.concatenate([ring, ring[:1]])] for ring in outlines], *grid)
        if not covered.any():
            raise InputError(f"{self.name}: no photograph shows any of it; check the area and its coordinate system")
        area_m2, shown = round(float(inside.sum()) * cell_m**2, 1), round(float(covered.sum() / inside.sum()), 4)
        return Cover(Path(self.name).name, area_m2, shown)

    def metres_to(self, place: Position) -> float:
        """About how far a place is from its box."""
        (west, south), (east, north) = self.in_system("EPSG:4326").box.tolist()
        latitude, longitude = np.clip((place.latitude_deg, place.longitude_deg), (south, west), (north, east)).tolist()
        return float(np.hypot(*place.metres_from(Position(latitude, longitude))))


def _burn(polygons: Sequence[Sequence[Points]], shape: tuple[int, int], transform: Affine) -> Mask:
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
        polygons = tuple(tuple(map(_close, rings)) for rings in found)
    # Whatever it is that the file has in place of numbers, names and lists.
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError, XmlTree.ParseError) as error:
        raise InputError(f"{path}: is no {path.suffix[1:]} file of polygons ({error}); export it again") from None
    if not polygons:
        raise InputError(f"{path}: has no polygon; draw the area as one, not as a line or a point")
    crs = read_system(path, name)
    for rings in polygons:
        convert_to_degrees(path, crs, np.concatenate(rings))
        if (place := _find_crossing(rings)) is not None:
            raise InputError(f"{path}: a polygon crosses itself near {place[0]:.8g}, {place[1]:.8g}; draw it anew")
    return Boundary(str(path), crs.to_string(), polygons)


def _close(points: Any) -> Points:
    """A ring as an array, closed."""
    ring = np.array([[float(x) for x in point[:2]] for point in points], np.float64)
    if len(ring) < 3 or ring.shape[1] != 2 or not np.isfinite(ring).all():
        raise ValueError("a ring has at least three corners, of two numbers each")
    return ring if (ring[0] == ring[-1]).all() else np.concatenate([ring, ring[:1]])


def _read_geojson(data: bytes) -> tuple[str, list[Any]]:
    """The name of the coordinate system, and the rings of all polygons."""

    def polygons(found: Any) -> Iterator[Any]:
        match found["type"]:
            case "Polygon":
                yield found["coordinates"]
            case "MultiPolygon":
                yield from found["coordinates"]
            case "Feature" if found["geometry"]:
                yield from polygons(found["geometry"])
            case "FeatureCollection" | "GeometryCollection" as kind:
                for each in found["features" if kind == "FeatureCollection" else "geometries"]:
                    yield from polygons(each)

    found = json.loads(data)
    # Left out of the format in 2016, and still written for all but degrees on WGS 84.
    named = found.get("crs")
    return named["properties"]["name"] if named else "EPSG:4326", list(polygons(found))


def _read_kml(data: bytes) -> tuple[str, list[Any]]:
    def corners(element: XmlTree.Element) -> list[list[str]]:
        return [point.split(",") for point in (element.text or "").split()]

    polygons = []
    for polygon in XmlTree.fromstring(data).findall(".//{*}Polygon"):
        rings = [polygon.findall(f"{{*}}{side}BoundaryIs/{_KML_RING}") for side in ("outer", "inner")]
        polygons.append([corners(ring) for side in rings for ring in side])
    return "EPSG:4326", polygons


def _find_crossing(rings: Sequence[Points]) -> Points | None:
    """A corner near which two edges of some rings cross, x and y; None without."""
    starts, ends = (np.concatenate([ring[part] for ring in rings]) for part in (np.s_[:-1], np.s_[1:]))
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    order = np.argsort(low[:, 0])
    starts, ends, low, high = starts[order], ends[order], low[order], high[order]

    def side(a: Array, b: Array, point: Array) -> Array:
        one, other = b - a, point - a
        return np.sign(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])

    for index in range(len(starts)):
        # Edges that begin before this one ends, from left to right.
        near = slice(index + 1, int(np.searchsorted(low[:, 0], high[index, 0], side="right")))
        a, b, c, d = starts[index], ends[index], starts[near], ends[near]
        crossing = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
        if crossing.any():
            return np.asarray(c[crossing][0])
    return None
