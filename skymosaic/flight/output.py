"""Writes the mosaic of one group of photographs, with its georeference and a preview for the report."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Pixels
from golden_model.text import how_to_install
from skymosaic.flight.composition import Composition
from skymosaic.flight.layout import Layout
from skymosaic.flight.survey import Flight
from skymosaic.geometry.homography import apply
from skymosaic.imagery.band_writer import write_bands
from skymosaic.imagery.geotiff import Georeference, georeference, has_writer, write_cog
from skymosaic.imagery.images import save

PREVIEW_WIDTH_PX = 1600
GEOTIFF_SUFFIXES = (".tif", ".tiff")


@dataclass(frozen=True, eq=False)
class Delivery:
    """A mosaic that was written.

    Attributes
    ----------
    path : Path
    flight : Flight
    layout : Layout
    composition : Composition
    georeference : Georeference or None
        Position of the mosaic on the map, if the photographs have GPS; a GeoTIFF contains it.
    map_note : str
        Why there is no georeference, why the file does not contain it, or why it may be wrong; else empty.
    preview : ndarray of uint8
        The mosaic, reduced.
    seconds : float
        For blending and writing.
    """

    path: Path
    flight: Flight
    layout: Layout
    composition: Composition
    georeference: Georeference | None
    map_note: str
    preview: Pixels
    seconds: float


def deliver(
    path: Path,
    flight: Flight,
    layout: Layout,
    composition: Composition,
    bands: Iterable[Pixels],
    *,
    preview_width_px: int = PREVIEW_WIDTH_PX,
) -> Delivery:
    """Write a mosaic.

    Parameters
    ----------
    path : Path
        With GPS, ``.tif`` becomes a GeoTIFF.
    flight : Flight
    layout : Layout
    composition : Composition
        Of that layout.
    bands : iterable of ndarray of uint8
        Its picture in bands of whole rows from the top, rendered as they are asked for.
    preview_width_px : int
        Of the preview, at most.

    Raises
    ------
    InputError
        If the file cannot be written or a photograph can no longer be read; no partial file is left.
    """
    start = time.perf_counter()
    position, note = on_map(flight, layout, composition)
    preview = _Preview(min(1.0, preview_width_px / composition.size[0]))
    watched = preview.watch(bands)
    channels = 3 if composition.coloured else 1
    if position is not None and _is_tiff(path) and has_writer():
        write_cog(path, composition.size, channels, watched, position)
        if len(layout.members) == 2:
            note = "two GPS positions fit exactly, so that nothing checks them"
    else:
        note = note or _why_not_on_the_map(path)
        if flight.pair is not None:
            # Two photographs fit into memory, and OpenCV's writers compress better than ours that write bands.
            save(path, np.concatenate(list(watched)))
        else:
            write_bands(path, composition.size, channels, watched)
    return Delivery(path, flight, layout, composition, position, note, preview.image(), time.perf_counter() - start)


def on_map(flight: Flight, layout: Layout, composition: Composition) -> tuple[Georeference | None, str]:
    """Where a mosaic lies by the GPS of its photographs, or None and why it is not known."""
    pairs = zip(composition.transforms, composition.placements, strict=True)
    centres = [apply(t, (np.array(p.size) - 1) / 2) for t, p in pairs]
    return georeference(np.array(centres), [flight.views[member].gps for member in layout.members])


def _is_tiff(path: Path) -> bool:
    return path.suffix.lower() in GEOTIFF_SUFFIXES


def _why_not_on_the_map(path: Path) -> str:
    if _is_tiff(path):
        return f"the file has no georeference; {how_to_install('geo')} to write a GeoTIFF"
    return f"{path.suffix} files have no georeference; .tif files do"


class _Preview:
    """Collects bands reduced by ``scale`` while they are written."""

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._bands: list[Pixels] = []

    def watch(self, bands: Iterable[Pixels]) -> Iterator[Pixels]:
        """The bands, unchanged."""
        for band in bands:
            size = (max(1, round(band.shape[1] * self._scale)), max(1, round(len(band) * self._scale)))
            self._bands.append(np.asarray(cv2.resize(band, size, interpolation=cv2.INTER_AREA), dtype=np.uint8))
            yield band

    def image(self) -> Pixels:
        """The reduced bands, joined."""
        return np.concatenate(self._bands)
