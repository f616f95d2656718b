"""Writes the mosaic of one group of photographs, with its georeference and a preview for the report."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Intensities, Pixels
from golden_model.temporary import temporary_folder
from skymosaic.common.errors import noting
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.formats import PLAIN, OutputForm, Picture, format_of, sources_of, too_deep_for_jpeg
from skymosaic.imagery.own_outputs import record_output
from skymosaic.maps.georeference import Georeference
from skymosaic.maps.geotiff import Shown, tee_sources, tee_to_raster
from skymosaic.maps.tiles import write_tiles

PREVIEW_WIDTH_PX = 1600


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
    sources: Path | None = None
    """Which photograph each pixel shows."""
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


def deliver(
    path: Path,
    flight: Flight,
    layout: Layout,
    composition: Composition,
    bands: Iterable[tuple[Intensities, Shown]],
    *,
    form: OutputForm = PLAIN,
    preview_width_px: int = PREVIEW_WIDTH_PX,
) -> Delivery:
    """Write the mosaic of a layout; ``.tif`` becomes a GeoTIFF.

    ``bands`` are its picture in bands of whole rows from the top, rendered as they are asked for, each with the
    photographs that it shows. Photographs of 16 bits are written with 16 bits into ``.tif``, otherwise as
    `Composition.values` says.

    Raises
    ------
    InputError
        If the mosaic cannot be written or a photograph can no longer be read; no partial file is left. What fails after
        it is among the failures of the delivery.
    """
    clock, kind = Stopwatch(), format_of(path)
    values, on_map = composition.values, composition.place.georeference
    if form.compress == "jpeg" and values is not None and values.deep:
        raise too_deep_for_jpeg(path)
    previews, failures = list[tuple[Pixels, Pixels]](), list[str]()
    # Every band is rendered once: on its way into the file it also fills the preview and the raster for tiles.
    bands = _collect_previews(bands, composition, min(1.0, preview_width_px / composition.size[0]), previews)
    with temporary_folder(path.parent) as folder:
        raster, sources = folder / "mosaic.tif", folder / "sources.tif"
        if form.sources:
            names = {1 + flight.sources[member].index: flight.view_names[member] for member in layout.members}
            bands = tee_sources(sources, composition.size, bands, on_map, names, mosaic=path)
        if kind.only_map:
            bands = ((composition.in_colour(pixels), shown) for pixels, shown in bands)
        if kind.on_map or form.tiles is not None:
            bands = tee_to_raster(raster, composition.size, bands, on_map, composition.band_names, mosaic=path)
        if kind.on_map:
            deque(bands, maxlen=0)
        kind.write(path, Picture(composition, bands, raster, form.compress, flight.pair is not None))
        beside = sources.replace(sources_of(path)) if form.sources else None
        # At once: if the tiles fail, the next run must not take the mosaic for a photograph.
        with noting(failures):
            for each in filter(None, (path, beside)):
                record_output(each, flight.folders)
        tiles = None
        with noting(failures):
            if form.tiles is not None:
                write_tiles(form.tiles, raster, path.stem, values)
                tiles = form.tiles
    note = composition.place.note
    if not note and not kind.on_map:
        note = f"{path.suffix} files have no georeference; .tif, .mbtiles and .kmz files do"
    preview, coverage = map(np.concatenate, zip(*previews, strict=True))
    seconds = clock.lap("writing")
    return Delivery(path, flight, layout, composition, note, preview, coverage, seconds, beside, tiles, tuple(failures))


def _collect_previews(
    bands: Iterable[tuple[Intensities, Shown]],
    composition: Composition,
    scale: float,
    previews: list[tuple[Pixels, Pixels]],
) -> Iterator[tuple[Intensities, Shown]]:
    """Pass on the bands of a picture, and append each, in 8 bits and reduced, to ``previews``, with its coverage."""
    for pixels, shown in bands:
        size = (max(1, round(pixels.shape[1] * scale)), max(1, round(len(pixels) * scale)))
        whole = composition.in_8_bit(pixels), 255 * (shown > 0).astype(np.uint8)
        small, coverage = (cv2.resize(each, size, interpolation=cv2.INTER_AREA).astype(np.uint8) for each in whole)
        previews.append((small, coverage))
        yield pixels, shown
