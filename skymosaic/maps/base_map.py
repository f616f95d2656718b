"""A map that exists already, and onto which a flight is laid: any raster with a place, read piece by piece."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
import rasterio.enums
import rasterio.errors
import rasterio.vrt

from golden_model.arrays import Matrix
from skymosaic.common.errors import InputError
from skymosaic.imagery.depth import measure_range
from skymosaic.imagery.images import Photograph
from skymosaic.maps.georeference import configured_rasterio

MIN_SHOWN = 0.3
"""A map that shows less of a frame tells too little of it."""


@dataclass(frozen=True, eq=False)
class BaseMap:
    """A raster with a place."""

    name: str
    crs: str
    to_map: Matrix
    """Pixels, centres at integers, to coordinates of the system, (3, 3)."""

    @property
    def grid(self) -> Matrix | None:
        """``to_map`` if pixels are squares, not mirrored; else None."""
        (a, b), (c, d) = self.to_map[:2, :2]
        return self.to_map if np.hypot(a + d, b - c) < 1e-6 * np.hypot(a, c) else None

    def cut(self, size: tuple[int, int], to_place: Matrix, crs: str) -> Photograph | None:
        """What it shows of a frame, whose pixels ``to_place`` takes to another system; None where it shows little."""
        corner = to_place @ np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
        frame = {"crs": crs, "transform": rasterio.Affine(*corner[:2].ravel()), "width": size[0], "height": size[1]}
        cubic = rasterio.enums.Resampling.cubic
        with _reading(self.name), rasterio.open(self.name) as file:
            alpha = rasterio.enums.ColorInterp.alpha in file.colorinterp
            bands = [3, 2, 1] if file.count >= 3 else [1]
            with rasterio.vrt.WarpedVRT(file, resampling=cubic, add_alpha=not alpha, **frame) as piece:
                pixels, shown = np.moveaxis(piece.read(bands), 0, -1).squeeze(), piece.dataset_mask()
        if (shown > 0).mean() < MIN_SHOWN:
            return None
        if pixels.dtype != np.uint8:
            values = pixels.astype(np.float32)
            values[shown == 0] = np.nan
            pixels = measure_range(values, self.name).to_8_bit(values)
        return Photograph(self.name, np.ascontiguousarray(pixels), visible=np.where(shown, 255, 0).astype(np.uint8))


@contextlib.contextmanager
def _reading(name: str) -> Iterator[None]:
    try:
        with configured_rasterio():
            yield
    except rasterio.errors.RasterioError as error:
        raise InputError(f"{name}: cannot be read as a map ({error}); give a GeoTIFF or another raster") from None


def load_base_map(path: Path) -> BaseMap:
    """Open a raster that has a coordinate system, on a map or in degrees, and a place in it.

    Raises
    ------
    InputError
        For a file that is no such raster.
    """
    with _reading(str(path)), rasterio.open(path) as file:
        crs, transform = file.crs, file.transform
    if crs is None or not (crs.is_projected or crs.is_geographic):
        raise InputError(f"{path}: has no coordinate system, so it is no map; give a georeferenced raster")
    corner = np.array([*transform[:6], 0, 0, 1], np.float64).reshape(3, 3)
    return BaseMap(str(path), crs.to_string(), corner @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]]))
