"""Mosaics of multi-band sets: one band is laid out, the others follow it on the same canvas."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Intensities, Pixels
from skymosaic.common.errors import InputError
from skymosaic.compositing.tone import NEUTRAL
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.view import View, describe
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.preparation import equalise, thumbnail_layers
from skymosaic.flight.picture.rig import Alignment, align_bands
from skymosaic.imagery.depth import measure_common_range
from skymosaic.imagery.photographs import Source
from skymosaic.maps.geotiff import Shown
from skymosaic.running.workers import Workers


@dataclass(frozen=True, eq=False)
class SpectralComposition(Composition):
    """Compositions of all bands on one canvas; what a `Composition` has besides is that of the band ``reference``."""

    each: tuple[Composition, ...] = ()
    reference: int = 0

    def render(self, tile: Canvas, memory_bytes: int) -> tuple[Intensities, Shown]:
        """Render one tile, (H, W, bands), 0 where not all bands show a photograph, and which one they do."""
        planes, shown = zip(*(band.render(tile, memory_bytes) for band in self.each), strict=True)
        mask = np.logical_and.reduce(shown)
        return np.stack(planes, axis=-1) * mask[..., None], shown[self.reference] * mask

    def empty(self, width_px: int, height_px: int) -> Intensities:
        """A black picture, (H, W, bands)."""
        return np.stack([super().empty(width_px, height_px)] * len(self.each), axis=-1)

    def in_8_bit(self, pixels: Intensities) -> Pixels:
        """Reduce the reference band to 8 bits, in gray."""
        return super().in_8_bit(np.ascontiguousarray(pixels[..., self.reference]))

    def for_tile(self, tile: Canvas) -> Composition:
        """Keep only the placements of each band that change a tile."""
        return dataclasses.replace(self, each=tuple(one.for_tile(tile) for one in self.each), placements=())


def in_all_bands(composition: Composition, flight: Flight, layout: Layout, workers: Workers) -> SpectralComposition:
    """Add the other bands to the composition of the reference band, for a flight whose sources are multi-band sets.

    Raises
    ------
    InputError
        For files that cannot be read, or differ in depth from one band to another.
    RegistrationError
        If a band cannot be aligned.
    """
    captures = [flight.sources[member] for member in layout.members]
    views = [flight.views[member] for member in layout.members]
    names = tuple(captures[0].bands)
    reference = next(name for name in names if captures[0].bands[name].content == captures[0].content)
    settings = dataclasses.replace(flight.settings, lens=flight.lens)
    alignments = align_bands(captures, reference, flight.lens, workers)
    each = {reference: composition}
    for name, alignment in alignments.items():
        sources = [capture.bands[name] for capture in captures]
        # Of another band, only what exposure needs is new.
        calls = [(source, settings, view.strongest[:0]) for source, view in zip(sources, views, strict=True)]
        band_views = list(workers.run(f"band {name}", describe, calls))
        band = _replace_band(composition, sources, band_views, alignment)
        # Two captures keep their exposures, as two photographs do; each band of more has exposures of its own.
        each[name] = equalise(band, band_views, thumbnail_layers(band, band_views)[0]) if flight.pair is None else band
    ordered = {name: each[name] for name in names}
    _check_one_type(ordered)
    shared = {field.name: getattr(composition, field.name) for field in dataclasses.fields(composition)}
    shared |= {"band_names": names, "aligned_px": {name: alignment.error_px for name, alignment in alignments.items()}}
    return SpectralComposition(**shared, each=tuple(ordered.values()), reference=names.index(reference))


def _replace_band(
    composition: Composition, sources: Sequence[Source], views: Sequence[View], alignment: Alignment
) -> Composition:
    """Keep canvas and seams of a composition, with the files of another band."""
    transforms = [placement.transform @ alignment.homography for placement in composition.placements]
    moved = composition.with_each(source=sources, transform=transforms, tone=[NEUTRAL] * len(sources))
    return dataclasses.replace(moved, values=measure_common_range([view.sample for view in views]))


def _check_one_type(each: Mapping[str, Composition]) -> None:
    """Check that all bands fit into one file."""
    types = {name: one.empty(1, 1).dtype for name, one in each.items()}
    first = next(iter(types))
    other = next((name for name, kind in types.items() if kind != types[first]), None)
    if other is not None:
        raise InputError(
            f"band {other} is written as {types[other]} and band {first} as {types[first]}; one file holds one type: "
            "leave out the files of either"
        )
