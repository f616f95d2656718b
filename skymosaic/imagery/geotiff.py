"""Georeferencing: fits a mosaic to the GPS positions of its photographs and writes it as a GeoTIFF."""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.errors import InputError
from skymosaic.geometry.homography import DegenerateError, apply, estimate
from skymosaic.imagery.exif import Position
from skymosaic.imagery.images import replacing
from skymosaic.temporary import temporary_folder

EQUATOR_RADIUS_M = 6_378_137.0
FLATTENING = 1 / 298.257223563
"""Radius and flattening of the WGS 84 ellipsoid."""
UTM_SCALE = 0.9996
"""Scale at the central meridian of a UTM zone."""
FEWEST_POSITIONS = 3
"""Two positions always fit a similarity exactly, so that a wrong one would not be noticed."""
WIDEST_RESIDUAL = 0.25
"""A fit is refused if its residual is larger than this share of the spread of the positions."""


@dataclass(frozen=True, eq=False)
class Georeference:
    """Position of a mosaic on the map.

    Attributes
    ----------
    epsg : int
        Code of the UTM zone on WGS 84.
    to_map : ndarray of float64, shape (3, 3)
        Canvas pixels, centres at integers, to metres east and north: a similarity.
    residual_m : float
        Root mean square distance of the photographs' centres from their GPS positions.
    metres_a_pixel : float
    """

    epsg: int
    to_map: Array
    residual_m: float
    metres_a_pixel: float


def georeference(centres: Array, gps: Sequence[Position | None]) -> tuple[Georeference | None, str]:
    """Fit a similarity from the canvas to the map by the photographs' centres and GPS positions.

    Parameters
    ----------
    centres : (N, 2) float64 ndarray
        Positions of the photographs' centres on the canvas, px.
    gps : sequence of Position or None
        GPS position of each photograph; None where it has none.

    Returns
    -------
    georeference : Georeference or None
    reason : str
        Why there is none; empty if there is one.
    """
    # Two photographs have no third position to check the fit with; the caller has to say so.
    fewest = min(FEWEST_POSITIONS, max(len(gps), 2))
    known = [index for index, position in enumerate(gps) if position is not None]
    if len(known) < fewest:
        return None, f"{len(known)} of {len(gps)} photographs have GPS; {fewest} are needed"
    positions = [position for position in gps if position is not None]
    epsg, metres = _utm(positions)
    # Rows count downwards and north points up. A similarity cannot mirror, so y is negated before the fit.
    upright = centres[known] * [1.0, -1.0]
    try:
        similarity = estimate(upright, metres, model="similarity")
    except DegenerateError:
        return None, "the GPS positions coincide or do not fit the layout at all"
    to_map = similarity @ np.diag([1.0, -1.0, 1.0])
    residual = float(np.sqrt(np.mean(np.sum((apply(to_map, centres[known]) - metres) ** 2, axis=1))))
    spread = float(np.sqrt(np.mean(np.sum((metres - metres.mean(axis=0)) ** 2, axis=1))))
    if residual > WIDEST_RESIDUAL * spread:
        return None, f"GPS and layout differ by {residual:.1f} m, too much for positions spread over {spread:.1f} m"
    return Georeference(epsg, to_map, residual, math.hypot(*similarity[:2, 0])), ""


def _utm(positions: Sequence[Position]) -> tuple[int, Array]:
    """EPSG code of the first position's UTM zone, and all positions in that zone, (N, 2) metres east and north."""
    zone = int((positions[0].longitude_deg + 180) // 6) % 60 + 1
    south = positions[0].latitude_deg < 0
    meridian = 6 * zone - 183
    metres = [_transverse_mercator(position, meridian) for position in positions]
    false_origin = np.array([500_000.0, 10_000_000.0 if south else 0.0])
    return (32700 if south else 32600) + zone, np.array(metres) + false_origin


def _transverse_mercator(position: Position, meridian_deg: float) -> tuple[float, float]:
    """Metres east of a central meridian and north of the equator, by Krüger's series: to a millimetre within a zone."""
    latitude, longitude = math.radians(position.latitude_deg), math.radians(position.longitude_deg - meridian_deg)
    n = FLATTENING / (2 - FLATTENING)
    eccentricity = 2 * math.sqrt(n) / (1 + n)
    sine = math.sin(latitude)
    t = math.sinh(math.atanh(sine) - eccentricity * math.atanh(eccentricity * sine))
    xi, eta = math.atan2(t, math.cos(longitude)), math.atanh(math.sin(longitude) / math.sqrt(1 + t * t))
    series = (n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16, 13 * n**2 / 48 - 3 * n**3 / 5, 61 * n**3 / 240)
    east, north = eta, xi
    for order, factor in enumerate(series, start=1):
        east += factor * math.cos(2 * order * xi) * math.sinh(2 * order * eta)
        north += factor * math.sin(2 * order * xi) * math.cosh(2 * order * eta)
    radius = UTM_SCALE * EQUATOR_RADIUS_M / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    return radius * east, radius * north


def has_writer() -> bool:
    """Whether the package that writes GeoTIFF is installed."""
    return importlib.util.find_spec("rasterio") is not None


def write_cog(
    path: Path, size: tuple[int, int], channels: int, bands: Iterable[Pixels], georeference: Georeference
) -> None:
    """Write a cloud-optimised GeoTIFF: tiled, deflated, with overviews; 0 stands for no data.

    Arguments as in `skymosaic.imagery.band_writer.write_bands`; needs the extra ``geo``.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    rasterio: Any = importlib.import_module("rasterio")
    shutil: Any = importlib.import_module("rasterio.shutil")
    # Rasterio's pixel coordinates start at the outer corner of the first pixel, ours at its centre.
    corner = georeference.to_map @ np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
    profile = {
        "driver": "GTiff", "width": size[0], "height": size[1], "count": channels, "dtype": "uint8", "nodata": 0,
        "crs": f"EPSG:{georeference.epsg}", "transform": rasterio.Affine(*corner[:2].ravel()), "tiled": True,
        "compress": "deflate", "bigtiff": "if_safer",
    }  # fmt: skip
    # GDAL's COG driver only copies finished data sets: it needs all pixels before it lays out the overviews.
    try:
        with replacing(path) as finished, temporary_folder(path.parent) as folder:
            plain = folder / "plain.tif"
            with rasterio.open(plain, "w", **profile) as file:
                top = 0
                for band in bands:
                    rgb = band[None] if band.ndim == 2 else cv2.cvtColor(band, cv2.COLOR_BGR2RGB).transpose(2, 0, 1)
                    file.write(rgb, window=rasterio.windows.Window(0, top, size[0], len(band)))
                    top += len(band)
            shutil.copy(plain, finished, driver="COG", compress="deflate", overview_resampling="average")
    except rasterio.errors.RasterioError as error:
        raise InputError(f"{path}: cannot be written ({error}); choose another folder") from None
