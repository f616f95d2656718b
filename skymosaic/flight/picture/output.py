"""Writes the mosaic of one group of photographs, with its georeference and a preview for the report."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Intensities, Mask, Pixels
from golden_model.temporary import temporary_folder
from skymosaic.common.errors import InputError, noting
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.picture.composition import Composition, Room
from skymosaic.imagery.band_writer import write_png
from skymosaic.imagery.images import save
from skymosaic.imagery.own_outputs import record_output
from skymosaic.maps.georeference import Georeference
from skymosaic.maps.geotiff import tee_to_raster, write_cog
from skymosaic.maps.tiles import write_tiles

PREVIEW_WIDTH_PX = 1600
GEOTIFF_SUFFIXES = (".tif", ".tiff")
MAX_SIDES_PX = {".jpg": 65_500, ".jpeg": 65_500, ".webp": 16_383}
BYTES_PER_SAMPLE = 6
"""Two bytes in the plain raster, its overviews, and as much again in the finished file."""


@dataclass(frozen=True)
class OutputForm:
    """How a mosaic is written."""

    compress: str = "deflate"
    """Compression of a GeoTIFF: deflate or jpeg."""
    tiles: Path | None = None
    """Folder for map tiles and a page that shows them."""
    require_map: bool = False
    """Write nothing without a place on the map."""

    def check(self, path: Path, bands: int = 0) -> None:
        """Refuse what cannot apply to a file, before anything is computed; ``bands`` is 0 but for multi-band mosaics.

        Raises
        ------
        InputError
            For an unsuitable compression, a file that cannot be a map, or bands that do not fit.
        """
        if bands and not _is_tiff(path):
            raise InputError(f"{path}: a mosaic of {bands} bands must be a .tif")
        if bands and (self.compress != "deflate" or self.tiles):
            raise InputError("compression and tiles are for photographs, not for multi-band sets; leave them out")
        if self.compress != "deflate" and not _is_tiff(path):
            raise InputError(f"{path}: {self.compress} compression is for .tif; leave it out, or end the name in .tif")
        if self.require_map and not _is_tiff(path) and self.tiles is None:
            raise InputError(f"{path}: {path.suffix} files are no maps, and a map is required; end the name in .tif")

    def numbered(self, number: int) -> OutputForm:
        """The form of one of several mosaics, counted from 1."""
        return self if self.tiles is None else replace(self, tiles=numbered(self.tiles, number))


PLAIN = OutputForm()


def numbered(path: Path, number: int) -> Path:
    """The name of one of several outputs, counted from 1."""
    return path if number == 1 else path.with_stem(f"{path.stem}_{number}")


@dataclass(frozen=True, eq=False)
class Delivery:
    """A written mosaic."""

    path: Path
    flight: Flight
    layout: Layout
    composition: Composition
    map_note: str
    """Why there is no georeference, why the file does not contain it, or why it may be wrong; else empty."""
    preview: Pixels
    """The mosaic, reduced."""
    coverage: Pixels
    """(H, W): how much of each pixel of the preview a photograph shows: 255, all of it."""
    seconds: float
    """Wall time of blending and writing."""
    tiles: Path | None = None
    """Folder of map tiles."""
    failures: tuple[str, ...] = ()
    """What could not be written beside the mosaic, and why."""

    @property
    def covered_px(self) -> float:
        """Canvas pixels that show a photograph."""
        width_px, height_px = self.composition.size
        return float(self.coverage.mean()) / 255 * width_px * height_px

    @property
    def georeference(self) -> Georeference | None:
        """Position of the mosaic on the map; a GeoTIFF contains it."""
        return self.composition.place.georeference


def room_for(path: Path, planes: int) -> Room:
    """How large the mosaic of a flight may become in a file of this name, with ``planes`` bands, alpha included."""
    suffix = path.suffix.lower()
    free_bytes = shutil.disk_usage(path.parent).free
    by_disk = f"the disk has {free_bytes >> 20} MB left"
    if suffix == ".png" or _is_tiff(path):
        return Room(free_bytes / (BYTES_PER_SAMPLE * planes), reason=by_disk)
    side_px = MAX_SIDES_PX.get(suffix, Room.side_px)
    # No file of the others is larger than the pixels.
    if free_bytes / planes < Room.area_px:
        return Room(free_bytes / planes, side_px, by_disk)
    if suffix in MAX_SIDES_PX:
        reason = f"{suffix} files have limits and the picture is in memory; a .tif has room for more"
        return Room(side_px=side_px, reason=reason)
    return Room()


def too_deep_for_jpeg(path: Path) -> InputError:
    """The error for a mosaic of 16 bits that is to be compressed as JPEG."""
    return InputError(f"{path}: JPEG holds 8 bits, the photographs have 16; leave out the compression")


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
    """Write the mosaic of a layout; ``.tif`` becomes a GeoTIFF.

    ``bands`` are its picture in bands of whole rows from the top, rendered as they are asked for, each with a mask of
    where a photograph shows. Photographs of 16 bits are written with 16 bits into ``.tif``, otherwise as
    `Composition.values` says.

    Raises
    ------
    InputError
        If the mosaic cannot be written or a photograph can no longer be read; no partial file is left. What fails after
        it is among the failures of the delivery.
    """
    clock = Stopwatch()
    values, on_map = composition.values, composition.place.georeference
    if form.compress == "jpeg" and values is not None and values.deep:
        raise too_deep_for_jpeg(path)
    previews, failures = list[tuple[Pixels, Pixels]](), list[str]()
    # Every band is rendered once: on its way into the file it also fills the preview and the raster for tiles.
    bands = _collect_previews(bands, composition, min(1.0, preview_width_px / composition.size[0]), previews)
    with temporary_folder(path.parent) as folder:
        raster = folder / "mosaic.tif"
        if _is_tiff(path) or form.tiles is not None:
            bands = tee_to_raster(raster, composition.size, bands, on_map, composition.band_names, mosaic=path)
        if _is_tiff(path):
            for _ in bands:
                pass
            write_cog(path, raster, form.compress)
        elif path.suffix.lower() == ".png" and flight.pair is None:
            pictures = (composition.in_8_bit(pixels) for pixels, _ in bands)
            write_png(path, composition.size, 3 if composition.coloured else 1, pictures)
        else:
            # All in memory; of two photographs PNG too, which OpenCV's writer compresses better.
            save(path, np.concatenate([composition.in_8_bit(pixels) for pixels, _ in bands]))
        # At once: if the tiles fail, the next run must not take the mosaic for a photograph.
        with noting(failures):
            record_output(path, flight.folders)
        tiles = None
        with noting(failures):
            if form.tiles is not None:
                write_tiles(form.tiles, raster, path.stem, values)
                tiles = form.tiles
    note = composition.place.note
    if not note and not _is_tiff(path):
        note = f"{path.suffix} files have no georeference; .tif files do"
    preview, coverage = map(np.concatenate, zip(*previews, strict=True))
    return Delivery(
        path, flight, layout, composition, note, preview, coverage, clock.lap("writing"), tiles, tuple(failures)
    )


def _collect_previews(
    bands: Iterable[tuple[Intensities, Mask]],
    composition: Composition,
    scale: float,
    previews: list[tuple[Pixels, Pixels]],
) -> Iterator[tuple[Intensities, Mask]]:
    """Pass on the bands of a picture, and append each, in 8 bits and reduced, to ``previews``, with its coverage."""
    for pixels, mask in bands:
        size = (max(1, round(pixels.shape[1] * scale)), max(1, round(len(pixels) * scale)))
        whole = composition.in_8_bit(pixels), 255 * mask.astype(np.uint8)
        small, coverage = (cv2.resize(each, size, interpolation=cv2.INTER_AREA).astype(np.uint8) for each in whole)
        previews.append((small, coverage))
        yield pixels, mask


def _is_tiff(path: Path) -> bool:
    return path.suffix.lower() in GEOTIFF_SUFFIXES
