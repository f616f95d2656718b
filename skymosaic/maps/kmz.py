"""Writes mosaics as KMZ for Google Earth."""

import errno
import math
import os
import zipfile
from pathlib import Path
from typing import Any

import rasterio
import rasterio.enums
import rasterio.shutil
import rasterio.vrt

from golden_model.temporary import temporary_folder
from skymosaic.common.errors import InputError
from skymosaic.common.temporary import write_atomically
from skymosaic.maps.geotiff import writing
from skymosaic.maps.tiles import TILE_PX, mercator_bounds

_GLOBE, STEP_DEG = "EPSG:4326", 1e-6
"""GDAL writes the edges of tiles on the globe with six decimals."""


def write_kmz(path: Path, raster: Path) -> None:
    """Copy a raster of `skymosaic.maps.geotiff.tee_to_raster` into a super-overlay, of which is loaded what is shown.

    The raster has 8 bits, colour and a place. Tiles are lossless where part of them is transparent, and JPEG elsewhere.

    Raises
    ------
    InputError
        If the file cannot be written, or for a mosaic across 180 degrees of longitude.
    """
    with write_atomically(path) as finished, temporary_folder(path.parent) as folder:
        with writing(path, raster.stat().st_size), rasterio.open(raster) as file:
            mercator_bounds(file, path)
            with _on_globe(file) as globe:
                rasterio.shutil.copy(globe, folder / "map.kmz", driver="KMLSUPEROVERLAY", format="auto", name=path.stem)
        try:
            # On a disk that is full, GDAL ends the file somewhere and keeps it to itself.
            with zipfile.ZipFile(folder / "map.kmz") as made:
                made.testzip()
        except zipfile.BadZipFile:
            raise InputError(
                f"{path}: cannot be written ({os.strerror(errno.ENOSPC)}); choose another folder"
            ) from None
        (folder / "map.kmz").replace(finished)


def _halvings(*sides_px: int) -> int:
    """How often a raster is halved until one tile shows it."""
    return max(math.ceil(math.log2(max(sides_px) / TILE_PX)), 0)


def _on_globe(file: Any) -> Any:
    """Open a raster in degrees, where each tile of each zoom is a whole number of pixels and of steps wide and high.

    GDAL would cut off the rest, and round the edges. Only of a raster in degrees does it write boxes, which it can read
    itself.
    """
    with rasterio.vrt.WarpedVRT(file, crs=_GLOBE) as usual:
        sides_px, (west, south, east, north) = usual.shape[::-1], (each / STEP_DEG for each in usual.bounds)
    left, top, tiles = math.floor(west), math.ceil(north), 1 << _halvings(*sides_px)
    across, down, width, height = (-int(-each // tiles) * tiles for each in (east - left, top - south, *sides_px))
    steps = across / width, 0, left, 0, -down / height, top
    transform = rasterio.Affine(*(STEP_DEG * each for each in steps))
    cubic = rasterio.enums.Resampling.cubic
    return rasterio.vrt.WarpedVRT(file, crs=_GLOBE, transform=transform, width=width, height=height, resampling=cubic)
