"""Writes mosaics as GeoTIFF with rasterio."""

import contextlib
import errno
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio.enums
import rasterio.errors
import rasterio.shutil
import rasterio.windows
from numpy.typing import NDArray

from golden_model.arrays import Intensities
from skymosaic.common.errors import InputError
from skymosaic.common.temporary import write_atomically
from skymosaic.maps.georeference import Georeference, configured_rasterio

JPEG_QUALITY = 90
DEFLATE_LEVEL = 3
"""Takes 60 % of the time of the usual level 6, for files 5 % larger."""
_OPTIONS: dict[str, dict[str, Any]] = {
    "deflate": {"predictor": "yes", "level": DEFLATE_LEVEL},
    "jpeg": {"quality": JPEG_QUALITY},
}
COMPRESSIONS = tuple(_OPTIONS)


Shown = NDArray[np.uint16]


def tee_to_raster(
    path: Path,
    size: tuple[int, int],
    bands: Iterable[tuple[Intensities, Shown]],
    georeference: Georeference | None,
    names: Sequence[str] = (),
    *,
    mosaic: Path | None = None,
) -> Iterator[tuple[Intensities, Shown]]:
    """Pass on the rows of a mosaic unchanged, and write them into a plain GeoTIFF with an alpha band.

    The file is complete when the rows have ended. It is not compressed, because it is read once and deleted. The rows
    come from the top, gray, BGR or with any number of channels, all of one type, and with which photograph they show, 0
    where they show none.
    ``names`` are those of the channels if these are bands; empty for gray or colour. Errors name the file ``mosaic``
    that ``path`` becomes.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with contextlib.ExitStack() as stack:
        file, top = None, 0
        for pixels, shown in bands:
            planes = [pixels] if pixels.ndim == 2 else cv2.split(pixels)
            # OpenCV's order is BGR, a file's RGB; bands are in order already.
            planes = planes[::-1] if len(planes) == 3 and not names else planes
            with _writing(mosaic or path):
                if file is None:
                    file = stack.enter_context(_create(path, (*size, len(planes)), pixels.dtype, georeference, names))
                opaque = (shown > 0) * pixels.dtype.type(np.iinfo(pixels.dtype).max)
                rows = rasterio.windows.Window(0, top, size[0], len(pixels))
                file.write(np.stack([*planes, opaque]), window=rows)
            top += len(pixels)
            yield pixels, shown


def tee_sources(
    path: Path,
    size: tuple[int, int],
    bands: Iterable[tuple[Intensities, Shown]],
    georeference: Georeference | None,
    names: Mapping[int, str],
    *,
    mosaic: Path,
) -> Iterator[tuple[Intensities, Shown]]:
    """Pass on the rows of a mosaic unchanged, and write which photograph each pixel shows into a GeoTIFF of one band.

    Its values are the numbers of the photographs, 0 is nodata; their ``names`` are the tags ``PHOTOGRAPH_1`` and so on.
    The file is complete when the rows have ended. Errors name the ``mosaic``.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    profile = {"driver": "GTiff", "width": size[0], "height": size[1], "count": 1, "dtype": "uint16", "nodata": 0}
    options = {"tiled": True, "bigtiff": "if_safer", "compress": "deflate", **_place(georeference)}
    top = 0
    with contextlib.ExitStack() as stack:
        with _writing(mosaic):
            file = stack.enter_context(rasterio.open(path, "w", **profile, **options))
            file.update_tags(**{f"PHOTOGRAPH_{number}": name for number, name in names.items()})
        for pixels, shown in bands:
            with _writing(mosaic):
                file.write(shown, 1, window=rasterio.windows.Window(0, top, size[0], len(shown)))
            top += len(shown)
            yield pixels, shown
        with _writing(mosaic):
            file.close()


def _place(georeference: Georeference | None) -> dict[str, Any]:
    return {} if georeference is None else {"crs": georeference.crs, "transform": georeference.transform}


@contextlib.contextmanager
def _writing(path: Path, least_bytes: int = 1 << 20) -> Iterator[None]:
    """Context in which rasterio's errors become one line about ``path``; with less free space the disk is full."""
    with configured_rasterio():
        try:
            yield
        # Copies raise the errors of GDAL itself, which are no RasterioError.
        except (rasterio.errors.RasterioError, rasterio._err.CPLE_BaseError) as error:
            # GDAL keeps the system's reason to itself.
            is_full = shutil.disk_usage(path.parent).free < least_bytes
            reason = os.strerror(errno.ENOSPC) if is_full else str(error.__cause__ or error)
            raise InputError(f"{path}: cannot be written ({reason}); choose another folder") from None


def _create(
    path: Path,
    shape: tuple[int, int, int],
    kind: np.dtype[Any],
    georeference: Georeference | None,
    names: Sequence[str],
) -> Any:
    """Create a file for rows of pixels; ``shape`` is its width, its height and its number of channels."""
    width_px, height_px, planes = shape
    # Classic TIFF ends at 4 GB.
    profile = {
        "driver": "GTiff", "width": width_px, "height": height_px, "count": planes + 1, "dtype": kind, "tiled": True,
        "bigtiff": "if_safer",
        "photometric": "rgb" if planes == 3 and not names else "minisblack",
    }  # fmt: skip
    file = rasterio.open(path, "w", **profile, **_place(georeference))
    file.colorinterp = (*file.colorinterp[:planes], rasterio.enums.ColorInterp.alpha)
    for number, name in enumerate(names, start=1):
        file.set_band_description(number, name)
    return file


def write_cog(path: Path, raster: Path, compress: str = "deflate") -> None:
    """Copy a plain GeoTIFF into a cloud-optimised one: tiled, with overviews; GDAL has to know all pixels first.

    "deflate" is lossless; "jpeg", for pictures of 8 bits, has a mask instead of the alpha band.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    # Several threads give the same bytes as one.
    options = {"num_threads": "ALL_CPUS", "overview_resampling": "average", "bigtiff": "if_safer"} | _OPTIONS[compress]
    # The errors' context is the inner one: by then what was written still fills the disk, except GDAL's overviews.
    with write_atomically(path) as finished, _writing(path, raster.stat().st_size):
        rasterio.shutil.copy(raster, finished, driver="COG", compress=compress, **options)
