"""Renders the mosaic of a layout tile by tile: only the photographs that a tile shows are decoded."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Array, Intensities, Pixels
from skymosaic.common.memory import release_free_memory
from skymosaic.compositing.blend import Blending, blend_layers
from skymosaic.compositing.layer import Layer, SeamMask
from skymosaic.compositing.mesh import Mesh
from skymosaic.compositing.tone import NEUTRAL, Tone
from skymosaic.compositing.warp import CANVAS_LIMIT_PX, Canvas, footprint, outline, shrink
from skymosaic.flight.mapping.place import NOWHERE, MapPlace
from skymosaic.imagery.depth import ValueRange, show_in_8_bit
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.orientation import UPRIGHT
from skymosaic.imagery.parcel import Parcel
from skymosaic.imagery.photographs import Source, decoded_photographs
from skymosaic.maps.boundary import Boundary
from skymosaic.maps.geotiff import Shown
from skymosaic.running.workers import Workers

MEMORY_BYTES = 1 << 30
"""Default limit of the decoded photographs a process keeps."""
BAND_REACH_PX = 128
"""Photographs farther than this from a tile do not change it: the margin of the widest band."""


@dataclass(frozen=True)
class Room:
    """How large the canvas of a flight may become; a larger one is reduced."""

    area_px: float = CANVAS_LIMIT_PX
    side_px: int = 1 << 30
    reason: str = "the whole picture is in memory"
    """What has no more room."""

    def share_of(self, canvas: Canvas) -> float:
        """By how much a canvas has to be reduced along its sides, at most 1."""
        longest = max(canvas.width_px, canvas.height_px)
        if canvas.area_px <= self.area_px and longest <= self.side_px:
            return 1.0
        # Rounding to whole pixels may add one on each side, before and after; so (share * width + 1) * (share * height
        # + 1) is the limit.
        width, height = canvas.width_px + 1, canvas.height_px + 1
        half = (1 / width + 1 / height) / 2
        by_area = math.sqrt(half**2 + (self.area_px - 1) / (width * height)) - half
        return min(by_area, (self.side_px - 1) / (longest + 1))


@dataclass(frozen=True, eq=False)
class Placement:
    """A photograph of a mosaic, not decoded."""

    source: Source
    size: tuple[int, int]
    """Width and height, px."""
    transform: Array
    """(3, 3): its pixels to pixels of the reference frame."""
    tone: Tone = NEUTRAL
    """What makes its intensities agree with those of its neighbours."""
    favour: float = 1.0
    """Below 1 for a blurred photograph, which shows only where no other does."""
    seam: SeamMask | None = None
    """Part that it may fill."""
    least_nearness: float = 0.0
    """Ground farther from the camera is not shown, see `skymosaic.compositing.warp.nearness`; 0 shows all."""
    mesh: Mesh | None = None
    """Warps it before ``transform``; None where it keeps its shape."""
    orientation: int = UPRIGHT
    """The EXIF orientation by which it was turned upright."""

    @cached_property
    def footprint(self) -> Canvas:
        """The rectangle of the reference frame that it may cover."""
        return footprint(self.size, self.transform, self.least_nearness)

    @property
    def outline(self) -> Array:
        """Corners (N, 2) of what may be shown of it, its pixels."""
        return outline(self.size, self.transform, self.least_nearness)

    @property
    def cut_off(self) -> float:
        """Share of it that is too far from the camera to be shown."""
        width, height = self.size
        return 1 - cv2.contourArea(self.outline.astype(np.float32)) / ((width - 1) * (height - 1))

    def shows_in(self, part: Canvas) -> bool:
        """Whether it shows in a part of the reference frame."""
        shown = self.footprint.intersection(part)
        return shown is not None and (self.seam is None or self.seam.shown_part(shown) is not None)


@dataclass(frozen=True, eq=False)
class Composition:
    """A mosaic that is ready to be rendered."""

    placements: tuple[Placement, ...]
    """In the order of the layout's members."""
    canvas: Canvas
    """The part of the reference frame that the mosaic fills."""
    coloured: bool
    """BGR, or gray where every photograph is gray."""
    blending: Blending
    lens: Lens
    values: ValueRange | None = None
    """The range of photographs of more than 8 bits, one for all; where it is deep, the mosaic has 16 bits."""
    place: MapPlace = NOWHERE
    """On the map; its georeference is that of the canvas's pixels."""
    boundary: Boundary | None = None
    """Where the picture ends, in the map's coordinate system."""
    whole: Canvas | None = None
    """What the canvas would be without the boundary, whose tiles are rendered; None: it has none."""
    band_names: tuple[str, ...] = ()
    """Names of the bands of a multi-band mosaic; else empty."""
    aligned_px: dict[str, float] = field(default_factory=dict)
    """The median error of the alignment of each band with the registering one, px."""
    reduced: str = ""
    uneven: str = ""
    """Why it is smaller than asked for, and what to do; what to expect of its brightness; else empty."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the canvas, px."""
        return self.canvas.width_px, self.canvas.height_px

    @property
    def cut_off(self) -> dict[str, float]:
        """Share of each photograph that is not shown, far beyond its ties, by name; the largest first."""
        shares = {placement.source.name: placement.cut_off for placement in self.placements if placement.least_nearness}
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    @property
    def transforms(self) -> list[Array]:
        """The transformation of each placement from its pixels to canvas pixels, (3, 3)."""
        return [self.canvas.translation @ placement.transform for placement in self.placements]

    def bands(self, workers: Workers, memory_bytes: int = MEMORY_BYTES) -> Iterator[tuple[Intensities, Shown]]:
        """Render the picture in bands of at most 1024 rows from the top, each with the photographs that it shows.

        Raises
        ------
        InputError
            If a photograph can no longer be read.
        """
        # Cut out of the whole mosaic's tiles, pixels are the same ones to the last bit.
        tiles = [tile for tile in (self.whole or self.canvas).tiles() if tile.intersection(self.canvas)]
        calls = [(self.for_tile(tile), tile, memory_bytes) for tile in tiles]
        rendered = zip(tiles, workers.run("mosaic", _render, calls), strict=True)
        top_px = 0
        for _, row in groupby(rendered, key=lambda item: item[0].y_px):
            pixels, shown = map(_join, zip(*(tile for _, tile in row), strict=True))
            if self.boundary is not None and (on_map := self.place.georeference) is not None:
                below = on_map.for_pixels(Canvas(0, -top_px, *self.size).translation)
                shown *= self.boundary.mask(shown.shape, below.transform)
                pixels[shown == 0] = 0
            top_px += len(shown)
            yield pixels, shown

    def render(self, tile: Canvas, memory_bytes: int) -> tuple[Intensities, Shown]:
        """Render one tile: its pixels, 0 where no photograph shows, and which one does."""
        if not self.placements:
            return self.empty(tile.width_px, tile.height_px), np.zeros((tile.height_px, tile.width_px), np.uint16)
        layers = [self.layer(each, memory_bytes) for each in self.placements]
        pixels, owner = blend_layers(layers, tile, method=self.blending)
        # The last one stands for none.
        numbers = np.array([*(1 + each.source.index for each in self.placements), 0], np.uint16)
        return pixels, numbers[owner]

    def layer(self, placement: Placement, memory_bytes: int) -> Layer:
        """A placement with its photograph, decoded, and no larger than the mosaic needs it."""
        pixels, own = decoded_photographs(memory_bytes).pixels(placement.source, self.lens, self.values)
        image, transform = shrink(pixels, placement.transform)
        if self.coloured and image.ndim == 2:
            image = np.dstack([image] * 3)
        visible = self.lens.turned(placement.orientation).visible_mask((image.shape[1], image.shape[0]), own)
        shown = placement.tone, visible, placement.favour, placement.seam, placement.least_nearness, placement.mesh
        return Layer(image, transform, *shown)

    def in_8_bit(self, pixels: Intensities) -> Pixels:
        """Reduce pixels of the mosaic to 8 bits."""
        return show_in_8_bit(pixels, self.values)

    def in_colour(self, pixels: Intensities) -> Pixels:
        """Reduce pixels of the mosaic to 8 bits of blue, green and red."""
        shown = self.in_8_bit(pixels)
        return shown if shown.ndim == 3 else np.dstack([shown] * 3)

    def joined(self, bands: Iterable[tuple[Intensities, Shown]]) -> Intensities:
        """Join the bands of `bands` into one picture, (H, W, 3) or (H, W), which is never in memory twice."""
        picture, top_px = self.empty(*self.size), 0
        for band, _ in bands:
            picture[top_px : top_px + len(band)] = band
            top_px += len(band)
        return picture

    def empty(self, width_px: int, height_px: int) -> Intensities:
        """A black picture of the mosaic's type."""
        shape = (height_px, width_px, 3) if self.coloured else (height_px, width_px)
        return np.zeros(shape, np.uint16 if self.values is not None and self.values.deep else np.uint8)

    def with_each(self, **values: Sequence[Any]) -> Composition:
        """Replace attributes of the placements, by a sequence of new values for each attribute."""
        rows = (dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True))
        placements = (replace(p, **row) for p, row in zip(self.placements, rows, strict=True))
        return replace(self, placements=tuple(placements))

    def for_tile(self, tile: Canvas) -> Composition:
        """Keep only the placements that change a tile; blending carries some across its border."""
        around = tile.grown(BAND_REACH_PX)
        return replace(self, placements=tuple(p for p in self.placements if p.shows_in(around)))


def _render(composition: Composition, tile: Canvas, memory_bytes: int) -> tuple[Parcel, Parcel]:
    """Render one tile, on a worker: the pixels of it that are on the canvas, and what they show."""
    pixels, shown = composition.render(tile, memory_bytes)
    release_free_memory()
    where = (tile.intersection(composition.canvas) or tile).within(tile)
    return Parcel(pixels[where]), Parcel(shown[where])


def _join(parcels: Sequence[Parcel]) -> Any:
    """Join the parts of a row of tiles."""
    return np.concatenate([parcel.pixels for parcel in parcels], axis=1)
