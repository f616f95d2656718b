"""Ground control points: surveyed places that photographs show."""

import cmath
import contextlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio.crs

from golden_model.arrays import Matrix, Points
from golden_model.small_files import read_small_file
from skymosaic.common.errors import InputError
from skymosaic.imagery.exif import Position
from skymosaic.imagery.images import PICTURE_SUFFIXES
from skymosaic.imagery.photographs import index_names
from skymosaic.maps.georeference import map_to_globe, project, project_to_utm

CHECK_PREFIX = "CHK-"
MAX_BYTES = 16 << 20
"""Room for a hundred thousand sightings."""
MAX_STRETCH, MAX_TURN_DEG, STEP_M = 0.005, 10.0, 100.0
"""National maps differ from UTM by up to 0.33 %, in Corsica, and by up to 8 degrees, in Bohemia."""
_UTM = re.compile(r"(?:WGS ?84 )?UTM (?:zone )?(0?[1-9]|[1-5]\d|60)([NS])", re.IGNORECASE)
"""A coordinate system as OpenDroneMap's users write it; rasterio reads all other forms."""
_NAME = re.compile(rf'"([^"]+)"|(.*?(?:{"|".join(map(re.escape, PICTURE_SUFFIXES))}))(?=\s|$)|(\S+)', re.IGNORECASE)


@dataclass(frozen=True)
class Sighting:
    """A control point as a photograph shows it."""

    point: int
    """Index of the control point."""
    photograph: str
    """Name of the file, with as many of its folders as the file of control points has."""
    x_px: float
    y_px: float
    """Its place in the file's pixels, centres at integers."""


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """The control points of a file."""

    name: str
    """Name of the file, for messages."""
    crs: str
    """The map's coordinate system, in metres."""
    metres: Points
    """East and north, (N, 2)."""
    names: tuple[str, ...]
    sightings: tuple[Sighting, ...]
    tried: int = 0
    """Photographs that may have been tied to another map. If any, pixels are those of straightened, upright ones."""
    grid: Matrix | None = None
    """The pixels of that map, centres at integers, to metres; None where they are no squares in metres."""

    @property
    def description(self) -> str:
        """How many photographs are tied to another map."""
        held = len({sighting.photograph for sighting in self.sightings})
        return f"{held} of {self.tried} photographs register with {Path(self.name).name}"

    def checks(self, point: int) -> bool:
        """Whether a point has no part in the layout and shows how exact it is."""
        return self.names[point].startswith(CHECK_PREFIX)

    def unmatched_names(self, photographs: Sequence[str]) -> list[str]:
        """Names in the file that are none of the photographs', rising."""
        find = index_names(photographs)
        return [name for name in sorted({sighting.photograph for sighting in self.sightings}) if not find(name)]


def load_control_points(path: Path) -> ControlPoints:
    """Read a file in OpenDroneMap's format ``gcp_list.txt``.

    The first line names the coordinate system (``EPSG:32615``, ``WGS84 UTM 15N`` or a PROJ string). Each further line
    has the coordinates x, y and z of a point, its pixel x and y in a photograph, the photograph's name and, if wanted,
    the point's name. Names that begin with CHK- make check points. Lines that start with # are comments.

    Raises
    ------
    InputError
        For a file that cannot be read, an unknown coordinate system, or a line of another form.
    """
    lines = read_lines(path, "control points")
    index: dict[tuple[float, float, float], int] = {}
    names: list[str] = []
    sightings = []
    for number, line in lines[1:]:
        place, pixel, photograph, name = _parse_line(path, number, line)
        # A point has a line per photograph. Its name is optional, so its coordinates identify it.
        if place not in index:
            index[place] = len(index)
            names.append("")
        point = index[place]
        # One line that says so makes a check point: it must not take part by mistake.
        if not names[point] or name.startswith(CHECK_PREFIX):
            names[point] = name
        sightings.append(Sighting(point, photograph, *pixel))
    crs, metres = convert_to_metres(path, lines[0][1], np.array(list(index))[:, :2])
    named = tuple(name or f"point {number}" for number, name in enumerate(names, start=1))
    return ControlPoints(str(path), crs, metres, named, tuple(sightings))


def _parse_line(path: Path, number: int, line: str) -> tuple[tuple[float, float, float], tuple[float, float], str, str]:
    """The coordinates of a point, its pixel, the photograph and the point's name, which may be empty."""
    with contextlib.suppress(ValueError):
        *numbers, names = line.split(maxsplit=5)
        x, y, z, column, row = map(float, numbers)
        if np.isfinite((x, y, z, column, row)).all():
            photograph, name = split_name(names)
            return (x, y, z), (column, row), photograph, " ".join(name.split()[:1])
    raise InputError(
        f"{path}: line {number} is {line!r}; it must be: x y z, pixel x and y, photograph, and perhaps a name"
    )


def split_name(text: str) -> tuple[str, str]:
    """A photograph's name at the start of a text, and the rest.

    It ends with a picture's suffix, so that it may have spaces, or stands in double quotes, or ends with a space.
    """
    found = _NAME.match(text)
    return (found[1] or found[2] or found[3], text[found.end() :].strip()) if found else (text, "")


def read_lines(path: Path, what: str) -> list[tuple[int, str]]:
    """Read the lines of a text file with their numbers, without comments; the first names the coordinate system.

    Raises
    ------
    InputError
        For a file that cannot be read, or has fewer than two lines.
    """
    try:
        text = read_small_file(path, MAX_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason}); give a text file of {what}, in UTF-8") from None
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("#")]
    if len(lines) < 2:
        raise InputError(f"{path}: no {what}; the first line names the coordinate system, each further a point")
    return lines


def read_system(path: Path, name: str) -> Any:
    """The coordinate system that a file names, as rasterio has it, in degrees or on a map.

    Raises
    ------
    InputError
        For an unknown system, or one without map coordinates: geocentric, vertical.
    """
    if "grids=" in name:
        raise InputError(f"{path}: {name!r} names files of grids, which are not read; give EPSG:32615 or the like")
    zone = _UTM.fullmatch(name)
    if zone is not None:
        name = f"EPSG:{326 if zone[2].upper() == 'N' else 327}{int(zone[1]):02}"
    try:
        crs = rasterio.crs.CRS.from_user_input(name)
    # Beside its own errors, rasterio raises ValueError, TypeError, RecursionError and others for what may be JSON.
    except Exception:
        raise InputError(f"{path}: {name!r} is no coordinate system; name one such as EPSG:32615") from None
    if not crs.is_geographic and not crs.is_projected:
        raise InputError(f"{path}: {name!r} has no map coordinates; name a system such as EPSG:32615")
    return crs


def convert_to_degrees(path: Path, crs: Any, points: Points) -> Points:
    """Longitudes and latitudes (N, 2) on WGS 84 of a file's points, whatever the datum and unit of its system.

    Raises
    ------
    InputError
        For points that are nowhere on the globe.
    """
    _check_unit(path, crs, points)
    try:
        degrees = map_to_globe(points, crs.to_string())
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if not (np.abs(degrees) <= (180, 90)).all():
        raise InputError(f"{path}: a longitude beyond 180 or a latitude beyond 90 degrees; x, the longitude, is first")
    return degrees


def _check_unit(path: Path, crs: Any, points: Points) -> None:
    """Raise InputError for degrees under a system in metres: they would all lie within a metre of its origin."""
    if crs.is_projected and (np.abs(points) <= (180, 90)).all() and np.ptp(points, axis=0).max() < 1:
        raise InputError(
            f"{path}: its coordinates are degrees, but {crs.to_string()} is in metres; begin with EPSG:4326"
        )


def convert_to_metres(path: Path, name: str, points: Points) -> tuple[str, Points]:
    """Points in metres to the east and north, and the name of their system: UTM, unless theirs is such."""
    crs = read_system(path, name)
    utm, metres = project_to_utm(_positions(path, crs, points))
    if crs.is_projected:
        steps = np.median(points, axis=0) + STEP_M * np.array([(0, 0), (1, 0), (0, 1)])
        start, east, north = project(_positions(path, crs, steps), utm) @ [1, 1j] / STEP_M
        if _is_true_to_ground(east - start, north - start):
            return crs.to_string(), points
    return utm, metres


def _positions(path: Path, crs: Any, points: Points) -> list[Position]:
    """Positions of points; raises as `convert_to_degrees` does."""
    return [Position(latitude, longitude) for longitude, latitude in convert_to_degrees(path, crs, points).tolist()]


def _is_true_to_ground(east: complex, north: complex) -> bool:
    """Whether steps along x and y, as complex numbers on a map in UTM, are metres to the east and to the north.

    Feet are not, nor is a map that is stretched, in one direction or in both, or whose axes point west and south.
    """
    stretch = max(abs(abs(east) - 1), abs(north - 1j * east))
    return stretch < MAX_STRETCH and abs(cmath.phase(east)) < math.radians(MAX_TURN_DEG)
