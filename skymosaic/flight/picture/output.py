"""Writes the mosaic of one group of photographs, with its georeference and a preview for the report."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Intensities, Mask, Pixels
from skymosaic.errors import InputError
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.survey import Flight
from skymosaic.imagery.band_writer import write_bands
from skymosaic.imagery.images import save
from skymosaic.maps.georeference import NO_MAPS, Georeference, has_maps
from skymosaic.maps.geotiff import COMPRESSIONS, tee_to_raster, write_cog
from skymosaic.maps.tiles import write_tiles
from skymosaic.temporary import temporary_folder

PREVIEW_WIDTH_PX = 1600
GEOTIFF_SUFFIXES = (".tif", ".tiff")


@dataclass(frozen=True)
class OutputForm:
    """How a mosaic is written.

    Attributes
    ----------
    compress : {"deflate", "jpeg"}
        Of a GeoTIFF.
    tiles : Path or None
        Folder for map tiles and a page that shows them.
    """

    compress: str = "deflate"
    tiles: Path | None = None

    def check(self, path: Path, bands: int = 0) -> None:
        """Refuse what cannot apply to a file, before anything is computed.

        Parameters
        ----------
        path : Path
        bands : int
            Of a multi-band mosaic; else 0.

        Raises
        ------
        InputError
            For an unknown or unsuitable compression, without the package for maps, or for bands that do not fit.
        """
        if bands and not _is_tiff(path):
            raise InputError(f"{path}: a mosaic of {bands} bands must be a .tif")
        if bands and not has_maps():
            raise InputError(f"{path}: a mosaic of {bands} bands is written as a map; {NO_MAPS}")
        if bands and self != PLAIN:
            raise InputError("compression and tiles are for photographs, not for multi-band sets; leave them out")
        if self.compress not in COMPRESSIONS:
            raise InputError(f"compress is {self.compress!r}; valid: {', '.join(COMPRESSIONS)}")
        if self.compress != "deflate" and not _is_tiff(path):
            raise InputError(f"{path}: {self.compress} compression is for .tif; leave it out, or end the name in .tif")
        if self != PLAIN and not has_maps():
            raise InputError(f"compression and tiles: {NO_MAPS}")

    def numbered(self, number: int) -> OutputForm:
        """That of one of several mosaics, counted from 1."""
        if self.tiles is None or number == 1:
            return self
        return replace(self, tiles=self.tiles.with_name(f"{self.tiles.name}_{number}"))


PLAIN = OutputForm()


@dataclass(frozen=True, eq=False)
class Delivery:
    """A mosaic that was written.

    Attributes
    ----------
    path : Path
    flight : Flight
    layout : Layout
    composition : Composition
    map_note : str
        Why there is no georeference, why the file does not contain it, or why it may be wrong; else empty.
    preview : ndarray of uint8
        The mosaic, reduced.
    seconds : float
        For blending and writing.
    tiles : Path or None
        Folder of map tiles.
    """

    path: Path
    flight: Flight
    layout: Layout
    composition: Composition
    map_note: str
    preview: Pixels
    seconds: float
    tiles: Path | None = None

    @property
    def georeference(self) -> Georeference | None:
        """Position of the mosaic on the map; a GeoTIFF contains it."""
        return self.composition.place.georeference


def deliver(
    path: Path,
    flight: Flight,
    layout: Layout,
    composition: Composition,
    bands: Iterable[tuple[Intensities, Mask]],
    *,
    form: OutputForm = PLAIN,
    preview_width_px: int = PREVIEW_WIDTH_PX,
) -> Delivery:
    """Write a mosaic.

    Parameters
    ----------
    path : Path
        With the extra ``geo``, ``.tif`` becomes a GeoTIFF.
    flight : Flight
    layout : Layout
    composition : Composition
        Of that layout.
    bands : iterable of (ndarray, ndarray)
        Its picture in bands of whole rows from the top, and where they show a photograph; rendered as they are asked
        for. Photographs of 16 bits are written with 16 bits into ``.tif``, otherwise as `Composition.values` says.
    form : OutputForm
    preview_width_px : int
        Of the preview, at most.

    Raises
    ------
    InputError
        If a file cannot be written or a photograph can no longer be read; no partial file is left.
    """
    start = time.perf_counter()
    values, on_map = composition.values, composition.place.georeference
    if form.compress == "jpeg" and values is not None and values.deep:
        raise InputError(f"{path}: JPEG holds 8 bits, the photographs have 16; leave out the compression")
    preview = _Preview(min(1.0, preview_width_px / composition.size[0]), composition)
    watched = preview.watch(bands)
    is_cog = _is_tiff(path) and has_maps()
    with temporary_folder(path.parent) as folder:
        raster = folder / "mosaic.tif"
        if is_cog or form.tiles is not None:
            watched = tee_to_raster(raster, composition.size, watched, on_map, composition.band_names)
        if is_cog:
            for _ in watched:
                pass
            write_cog(path, raster, form.compress)
        else:
            pictures = (pixels if _is_tiff(path) else composition.in_8_bit(pixels) for pixels, _ in watched)
            _write_picture(path, flight, composition, pictures)
        if form.tiles is not None:
            write_tiles(form.tiles, raster, path.stem, values)
    note = composition.place.note or _why_not_on_the_map(path)
    return Delivery(path, flight, layout, composition, note, preview.image(), time.perf_counter() - start, form.tiles)


def _write_picture(path: Path, flight: Flight, composition: Composition, pictures: Iterable[Intensities]) -> None:
    """Write a file that is no GeoTIFF."""
    if flight.pair is not None:
        # Two photographs fit into memory, and OpenCV's writers compress better than ours that write bands.
        save(path, np.concatenate(list(pictures)))
    else:
        write_bands(path, composition.size, 3 if composition.coloured else 1, pictures)


def _is_tiff(path: Path) -> bool:
    return path.suffix.lower() in GEOTIFF_SUFFIXES


def _why_not_on_the_map(path: Path) -> str:
    return "" if _is_tiff(path) else f"{path.suffix} files have no georeference; .tif files do"


class _Preview:
    """Collects bands reduced by ``scale`` while they are written."""

    def __init__(self, scale: float, composition: Composition) -> None:
        self._scale = scale
        self._composition = composition
        self._bands: list[Pixels] = []

    def watch(self, bands: Iterable[tuple[Intensities, Mask]]) -> Iterator[tuple[Intensities, Mask]]:
        """The bands, unchanged."""
        for band, shown in bands:
            size = (max(1, round(band.shape[1] * self._scale)), max(1, round(len(band) * self._scale)))
            small = cv2.resize(self._composition.in_8_bit(band), size, interpolation=cv2.INTER_AREA)
            self._bands.append(np.asarray(small, dtype=np.uint8))
            yield band, shown

    def image(self) -> Pixels:
        """The reduced bands, joined."""
        return np.concatenate(self._bands)
