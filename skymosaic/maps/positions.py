"""Positions of cameras from a file, instead of those that the photographs contain."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skymosaic.common.errors import InputError
from skymosaic.imagery.exif import Position
from skymosaic.imagery.photographs import index_names
from skymosaic.maps.control_points import convert_to_degrees, read_lines, read_system, split_name

ACCURACY_COLUMN = 6
"""Column of the horizontal accuracy, after the coordinates x, y and z and three angles."""


@dataclass(frozen=True)
class Fix:
    """Where a camera was."""

    photograph: str
    """Name of the file, with as many of its folders as the file of positions has."""
    position: Position
    accuracy_m: float | None
    """Horizontal standard deviation."""


@dataclass(frozen=True)
class Positions:
    """The positions of a file; ``name`` is the file's, for messages."""

    name: str
    fixes: tuple[Fix, ...]

    def find(self, photographs: Sequence[str]) -> list[Fix | None]:
        """The fix of each photograph, None without one.

        Raises
        ------
        InputError
            For a name that is no photograph's, or that of several.
        """
        found: list[Fix | None] = [None] * len(photographs)
        find = index_names(photographs)
        for fix in self.fixes:
            indices = find(fix.photograph)
            if len(indices) != 1:
                count = "no photograph" if not indices else f"{len(indices)} photographs; add their folders"
                raise InputError(f"{self.name}: {fix.photograph} is {count}")
            if found[indices[0]] is not None:
                raise InputError(f"{self.name}: {fix.photograph} has two positions; leave one out")
            found[indices[0]] = fix
        return found


def load_positions(path: Path) -> Positions:
    """Read a file in OpenDroneMap's format ``geo.txt``.

    The first line names the coordinate system, as in `skymosaic.maps.control_points.load_control_points`. Each further
    line has the photograph's name, x, y and perhaps z, then perhaps three angles, which are not used, and the
    horizontal accuracy in metres.

    Raises
    ------
    InputError
        For a file that cannot be read, an unknown coordinate system, or a line of another form.
    """
    lines = read_lines(path, "positions")
    crs = read_system(path, lines[0][1])
    rows = [_parse_line(path, number, line) for number, line in lines[1:]]
    places = np.array([place for _, place, _ in rows])
    degrees = convert_to_degrees(path, crs, places)
    return Positions(
        str(path),
        tuple(
            Fix(name, Position(latitude, longitude), accuracy_m)
            for (name, _, accuracy_m), (longitude, latitude) in zip(rows, degrees.tolist(), strict=True)
        ),
    )


def _parse_line(path: Path, number: int, line: str) -> tuple[str, tuple[float, float], float | None]:
    """The photograph's name, its x and y, and the accuracy, which may be missing."""
    name, rest = split_name(line)
    with contextlib.suppress(ValueError):
        numbers = [float(each) for each in rest.split()[: ACCURACY_COLUMN + 1]]
        x, y = numbers[:2]
        accuracy_m = numbers[ACCURACY_COLUMN] if len(numbers) > ACCURACY_COLUMN else 0.0
        if np.isfinite(numbers).all() and accuracy_m >= 0:
            return name, (x, y), accuracy_m or None
    raise InputError(f"{path}: line {number} is {line!r}; it must be: photograph, x, y, and perhaps more numbers")
