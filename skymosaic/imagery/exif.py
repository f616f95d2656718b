"""Reads EXIF and XMP data of a photograph: position, focal length, yaw, height, black level."""

from __future__ import annotations

import contextlib
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from PIL.ExifTags import GPS, IFD, Base

from golden_model.text import one_line
from skymosaic.common.later import Later
from skymosaic.imagery.decoding import open_header

_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0}  # EXIF's codes of inch, centimetre and millimetre
_HALF_DIAGONAL_35_MM = math.hypot(36, 24) / 2
MIN_FOCAL, MAX_FOCAL = 0.3, 20.0
"""Focal lengths outside these limits are mistakes. They are 6.5 and 430 mm on 35 mm film."""
MAX_ROUNDING = 0.1
# The gimbal's yaw is the camera's; the aircraft's own is the last resort.
_YAW = ("drone-dji:GimbalYawDegree", "Camera:Yaw", "drone-dji:FlightYawDegree")
_HEIGHT = ("drone-dji:RelativeAltitude", "Camera:AboveGroundAltitude")
# DJI's older firmware has the misspelt name.
_LATITUDE, _LONGITUDE = ("drone-dji:GpsLatitude",), ("drone-dji:GpsLongitude", "drone-dji:GpsLongtitude")
_ACCURACY = ("drone-dji:RtkStdLon", "drone-dji:RtkStdLat")
_DATUMS = {
    **dict.fromkeys(("", "WGS84"), 4326),
    **{"TOKYO": 4301, "JGD2000": 4612, "JGD2011": 6668, "NAD27": 4267, "NAD83": 4269},
    **{"ED50": 4230, "ETRS89": 4258, "GDA94": 4283, "GDA2020": 7844, "CGCS2000": 4490},
}
"""EPSG's numbers of datums, by their names in capitals, without spaces and hyphens."""
_RECEIVED = (GPS.GPSLatitude, GPS.GPSLongitude, GPS.GPSAltitude, GPS.GPSTimeStamp, GPS.GPSDateStamp)
"""What cameras write, in part also while their receivers do not know the place yet."""
NIGHT = timedelta(hours=8)
"""A longer break lies between two days. A flight may last through midnight, which clocks of another zone have at noon.
"""
_EARTH_RADIUS_M = 6_371_000


@dataclass(frozen=True)
class Position:
    """A position on the WGS 84 ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    """Positive to the north and to the east."""

    @property
    def degrees(self) -> tuple[float, float]:
        """Longitude and latitude, as coordinates x and y."""
        return self.longitude_deg, self.latitude_deg

    def metres_from(self, origin: Position) -> tuple[float, float]:
        """Metres to the east and to the north of ``origin``, on a sphere; within 0.5 % over a few kilometres."""
        per_degree = _EARTH_RADIUS_M * math.pi / 180
        east_deg = (self.longitude_deg - origin.longitude_deg + 180) % 360 - 180
        east = east_deg * per_degree * math.cos(math.radians(origin.latitude_deg))
        return east, (self.latitude_deg - origin.latitude_deg) * per_degree


@dataclass(frozen=True)
class Metadata:
    """What a camera wrote about a photograph; None where it wrote nothing valid."""

    position: Position | None = None
    """From GPS in EXIF, or in DJI's XMP."""
    focal_half_diagonals: float | None = None
    """Focal length as a multiple of half the image's diagonal."""
    yaw_deg: float | None = None
    """Direction of the photograph's top, clockwise from north."""
    height_m: float | None = None
    """Height above the place of take-off."""
    black_level: float | None = None
    """The sensor's count without light, in the file's own numbers."""
    accuracy_m: float | None = None
    """Horizontal standard deviation of the position, from RTK."""
    gps_fault: str = ""
    """Why what GPS wrote is no position; empty if it is one, or there is nothing."""
    time: str = ""
    """When it was taken by the camera's clock, "2026-05-01 10:20:30"; empty if that is not known."""
    camera: str = ""
    """Make and model; empty if they are not known."""
    own_position: Position | None = None
    """The one that the camera wrote, where a file's has taken its place."""


def read_metadata(path: Path) -> Metadata:
    """Read a file's EXIF and XMP data; missing or invalid values are None."""
    try:
        with open_header(path) as header:
            exif = header.getexif()
            gps, details = exif.get_ifd(IFD.GPSInfo), exif.get_ifd(IFD.Exif)
            xmp = header.info.get("xmp", b"")
    # For EXIF data of unknown origin, Pillow raises SyntaxError, struct.error and others beside the expected errors.
    except Exception:
        return Metadata()
    text = xmp.decode("utf-8", "replace") if isinstance(xmp, bytes) else str(xmp)
    # DNG's tag, which multi-band cameras write into TIFF.
    black = _black(exif.get(Base.BlackLevel))
    accuracy = [_from_xmp(text, (name,)) or 0.0 for name in _ACCURACY]
    position, fault = _position(gps)
    if position is None:
        latitude, longitude = _from_xmp(text, _LATITUDE), _from_xmp(text, _LONGITUDE)
        position = None if latitude is None or longitude is None else on_globe(latitude, longitude)
    return Metadata(
        position,
        _focal(details),
        _from_xmp(text, _YAW),
        _from_xmp(text, _HEIGHT),
        black,
        max(accuracy) if min(accuracy) > 0 else None,
        "" if position else fault,
        _time(details.get(Base.DateTimeOriginal) or exif.get(Base.DateTime)),
        _camera(exif.get(Base.Make), exif.get(Base.Model)),
    )


def explain_missing_gps(taken: Sequence[Metadata]) -> str:
    """Say that no photograph has a position, and what is wrong with the positions that cameras wrote."""
    faults = describe_gps_faults(taken)
    return f"0 of {len(taken)} photographs have GPS{faults and f' that can be used, but {faults}'}"


def describe_gps_faults(taken: Sequence[Metadata]) -> str:
    """How many photographs have GPS that is no position, and what is wrong with most of it; empty if none has."""
    faults = Counter(each.gps_fault for each in taken if each.gps_fault)
    has = "has" if faults.total() == 1 else "have"
    return f"{faults.total()} {has} GPS {faults.most_common(1)[0][0]}" if faults else ""


def describe_days(taken: Sequence[Metadata]) -> str:
    """On which days photographs were taken and what to do; empty if they are of one day, as far as that is known."""
    times = sorted(datetime.fromisoformat(each.time) for each in taken if each.time)
    days, day = Counter[str](), ""
    for before, time in pairwise([datetime.min, *times]):
        day = str(time.date()) if time - before > NIGHT else day
        days[day] += 1
    counts = ", ".join(f"{count} of {day}" for day, count in days.items())
    remedy = "what has changed between them shows in patches; make a mosaic of each day"
    return f"taken on {len(days)} days ({counts}): {remedy}" if len(days) > 1 else ""


def _time(written: Any) -> str:
    """EXIF's 2026:05:01 10:20:30 as ISO writes dates."""
    with contextlib.suppress(ValueError):
        return datetime.strptime(str(written)[:19], "%Y:%m:%d %H:%M:%S").isoformat(" ")
    return ""


def _camera(make: Any, model: Any) -> str:
    """Make and model, of which some cameras write the make twice."""
    first, second = (one_line(str(each or "").partition("\0")[0].strip()) for each in (make, model))
    return second if second.lower().startswith(first.lower()) else f"{first} {second}".strip()


def _black(levels: Any) -> float | None:
    """The mean of the levels; a sensor with a colour pattern has several."""
    each = [_number(level) for level in (levels if isinstance(levels, tuple) else (levels,))]
    return float(np.mean(each)) if min(each) > 0 else None


def _position(gps: Mapping[int, Any]) -> tuple[Position | None, str]:
    """The position that EXIF has, or None and what is wrong with it."""
    if GPS.GPSLatitude not in gps or GPS.GPSLongitude not in gps:
        return None, "without latitude and longitude" if any(tag in gps for tag in _RECEIVED) else ""
    if not gps.get(GPS.GPSLatitudeRef) or not gps.get(GPS.GPSLongitudeRef):
        return None, "without a hemisphere (N or S, E or W)"
    try:
        latitude = _degrees(gps[GPS.GPSLatitude], gps[GPS.GPSLatitudeRef], {"N": 1, "S": -1})
        longitude = _degrees(gps[GPS.GPSLongitude], gps[GPS.GPSLongitudeRef], {"E": 1, "W": -1})
    # Text, another hemisphere: none of it is a position.
    except Exception:
        return None, "that is no position"
    if (position := on_globe(latitude, longitude)) is None:
        return None, f"that is no position (latitude {latitude:g}, longitude {longitude:g})"
    return _to_wgs84(position, str(gps.get(GPS.GPSMapDatum, "")).partition("\0")[0])


def _to_wgs84(position: Position, datum: str) -> tuple[Position | None, str]:
    """A position that a camera wrote in another datum, some of which are hundreds of metres off."""
    epsg = _DATUMS.get(re.sub(r"[\s-]", "", datum.upper()))
    if epsg is None:
        return None, f"in the datum {one_line(datum)!r}, which is not known; give `positions` in a system that is"
    if epsg == _DATUMS["WGS84"]:
        return position, ""
    ((longitude_deg,), (latitude_deg,)) = Later("rasterio.warp").transform(
        f"EPSG:{epsg}", "EPSG:4326", [position.longitude_deg], [position.latitude_deg]
    )
    return Position(latitude_deg, longitude_deg), ""


def on_globe(latitude_deg: float, longitude_deg: float) -> Position | None:
    """The position, unless it is none: without reception, cameras write zeros, NaN or values out of range."""
    known = (latitude_deg, longitude_deg) != (0, 0) and abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180
    return Position(latitude_deg, longitude_deg) if known else None


def _degrees(parts: tuple[Any, Any, Any], hemisphere: str, signs: Mapping[str, int]) -> float:
    degrees, minutes, seconds = map(float, parts)
    # Cameras write lower case, the whole word, or a zero byte behind it.
    sign = signs[hemisphere.strip()[0].upper()]
    # Programs repeat it in the numbers, which have none in EXIF.
    if degrees < 0 < sign:
        raise ValueError("minus to the north or east")
    return sign * (abs(degrees) + abs(minutes) / 60 + abs(seconds) / 3600)


def _focal(details: Mapping[int, Any]) -> float | None:
    """Focal length in half diagonals, from millimetres and pixel density, or from the rounded length on 35 mm film.

    Programs that reduce a photograph may leave the density unchanged. The two lengths then contradict each other, and
    the one on film is right.
    """
    equivalent = _number(details.get(Base.FocalLengthIn35mmFilm)) / _HALF_DIAGONAL_35_MM
    size_px = math.hypot(_number(details.get(Base.ExifImageWidth)), _number(details.get(Base.ExifImageHeight)))
    mm_per_unit = _MM_PER_UNIT.get(details.get(Base.FocalPlaneResolutionUnit, 2), math.nan)
    density = _number(details.get(Base.FocalPlaneXResolution)) / mm_per_unit
    focal_px = _number(details.get(Base.FocalLength)) * density
    by_pixels = focal_px / (size_px / 2) if size_px else math.nan
    agree = abs(by_pixels - equivalent) < MAX_ROUNDING * equivalent
    focal = by_pixels if agree or not equivalent else equivalent
    return focal if MIN_FOCAL < focal < MAX_FOCAL else None


def _number(value: Any) -> float:
    """Convert EXIF data to a number; 0 for None, text, 0/0 and the like."""
    try:
        return float(value)
    except Exception:
        return 0.0


def _from_xmp(text: str, names: tuple[str, ...]) -> float | None:
    """The first of the properties that is a finite number, as an attribute or as an element."""
    for name in names:
        match = re.search(rf"\b{name}(?:=[\"']|>)\s*([-+]?\d+(?:\.\d*)?)\s*[\"'<]", text)
        if match is not None:
            return float(match[1])
    return None
