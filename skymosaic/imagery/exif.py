"""The GPS position that a camera wrote into a photograph's EXIF data."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image as PillowImage

_GPS_DIRECTORY = 0x8825
_LATITUDE_SIGN, _LATITUDE, _LONGITUDE_SIGN, _LONGITUDE, _ALTITUDE_SIGN, _ALTITUDE = 1, 2, 3, 4, 5, 6
_EARTH_RADIUS_M = 6_371_000


@dataclass(frozen=True)
class Position:
    """A position on the WGS 84 ellipsoid.

    Attributes
    ----------
    latitude_deg, longitude_deg : float
        Positive to the north and to the east.
    altitude_m : float
        Above sea level; 0 if the camera wrote none.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0

    def metres_from(self, origin: Position) -> tuple[float, float]:
        """Metres to the east and to the north of ``origin``, on a sphere: accurate to 0.5 % over a few kilometres."""
        per_degree = _EARTH_RADIUS_M * math.pi / 180
        east_deg = (self.longitude_deg - origin.longitude_deg + 180) % 360 - 180
        east = east_deg * per_degree * math.cos(math.radians(origin.latitude_deg))
        return east, (self.latitude_deg - origin.latitude_deg) * per_degree


def position(path: Path) -> Position | None:
    """The GPS position in a file's EXIF data; None if there is none or it is not valid."""
    try:
        with PillowImage.open(path) as header:
            gps = header.getexif().get_ifd(_GPS_DIRECTORY)
        latitude = _degrees(gps[_LATITUDE], gps.get(_LATITUDE_SIGN), negative="S")
        longitude = _degrees(gps[_LONGITUDE], gps.get(_LONGITUDE_SIGN), negative="W")
        altitude = float(gps.get(_ALTITUDE, 0.0)) * (-1 if gps.get(_ALTITUDE_SIGN) in (1, b"\x01") else 1)
    # EXIF data of unknown origin: Pillow raises SyntaxError, struct.error and others beside the expected ones.
    except Exception:
        return None
    # Cameras without GPS reception write zeros or values out of range.
    known = math.isfinite(latitude + longitude + altitude) and (latitude, longitude) != (0, 0)
    if not (known and abs(latitude) <= 90 and abs(longitude) <= 180):
        return None
    return Position(latitude, longitude, altitude)


def _degrees(parts: tuple[Any, Any, Any], sign: object, *, negative: str) -> float:
    degrees, minutes, seconds = map(float, parts)
    value = degrees + minutes / 60 + seconds / 3600
    return -value if sign == negative else value
