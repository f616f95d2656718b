"""The mosaic of one group of photographs as a file, with its place on the map and a preview for the report."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.flight.composition import Composition
from skymosaic.flight.layout import Layout
from skymosaic.flight.survey import Flight
from skymosaic.flight.workers import Workers
from skymosaic.geometry.homography import apply
from skymosaic.imagery.band_writer import write_bands
from skymosaic.imagery.geotiff import Georeference, georeference, has_writer, write_cog

PREVIEW_WIDTH_PX = 1600
GEOTIFF_SUFFIXES = (".tif", ".tiff")


@dataclass(frozen=True, eq=False)
class Delivery:
    """What was written, and how.

    Attributes
    ----------
    path : Path
    flight : Flight
    layout : Layout
    composition : Composition
    place : Georeference or None
        Where the mosaic lies, if GPS tells; a GeoTIFF says so too.
    map_note : str
        Why there is no place, or why the file does not say it; empty where it does.
    preview : ndarray of uint8
        The mosaic reduced to at most 1600 px wide.
    seconds : float
        For blending and writing.
    """

    path: Path
    flight: Flight
    layout: Layout
    composition: Composition
    place: Georeference | None
    map_note: str
    preview: Pixels
    seconds: float


def deliver(
    path: Path, flight: Flight, layout: Layout, composition: Composition, *, workers: Workers, memory_bytes: int
) -> Delivery:
    """Blend and write a mosaic.

    Raises
    ------
    InputError
        If the file cannot be written or a photograph no longer be read; nothing is left of it then.
    """
    start = time.perf_counter()
    middles = [apply(p.transform, (np.array(p.size) - 1) / 2) for p in composition.placements]
    place, note = georeference(np.array(middles), [flight.views[member].place for member in layout.members])
    preview = _Preview(composition.size[0])
    bands = preview.watch(composition.bands(workers, memory_bytes))
    channels = 3 if composition.coloured else 1
    if place is not None and path.suffix.lower() in GEOTIFF_SUFFIXES and has_writer():
        write_cog(path, composition.size, channels, bands, place)
    else:
        write_bands(path, composition.size, channels, bands)
        note = note or _unsaid(path)
    seconds = time.perf_counter() - start
    return Delivery(path, flight, layout, composition, place, note, preview.image(), seconds)


def _unsaid(path: Path) -> str:
    if path.suffix.lower() in GEOTIFF_SUFFIXES:
        return "the file does not say where it lies: pip install 'skymosaic[geo]' writes a GeoTIFF"
    return f"{path.suffix} cannot say where the mosaic lies; .tif can"


class _Preview:
    """Reduces the bands that pass through it."""

    def __init__(self, width_px: int) -> None:
        self._scale = min(1.0, PREVIEW_WIDTH_PX / width_px)
        self._bands: list[Pixels] = []

    def watch(self, bands: Iterable[Pixels]) -> Iterator[Pixels]:
        """The bands as they are."""
        for band in bands:
            size = (max(1, round(band.shape[1] * self._scale)), max(1, round(len(band) * self._scale)))
            self._bands.append(np.asarray(cv2.resize(band, size, interpolation=cv2.INTER_AREA), dtype=np.uint8))
            yield band

    def image(self) -> Pixels:
        """What has passed, from the top."""
        return np.concatenate(self._bands)
