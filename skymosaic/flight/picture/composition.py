"""Renders the mosaic of a layout tile by tile: only the photographs that a tile shows are decoded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Array, Intensities, Mask, Pixels
from skymosaic.compositing.blend import blend_layers, layers_of
from skymosaic.compositing.exposure import camera_levels, exposure_tones, toned_range
from skymosaic.compositing.layer import Layer, SeamMask
from skymosaic.compositing.seams import seam_masks
from skymosaic.compositing.tone import NEUTRAL, Tone
from skymosaic.compositing.warp import (
    CANVAS_LIMIT_PX,
    TILE_PX,
    Canvas,
    CanvasError,
    canvas_of,
    footprint,
    magnification,
)
from skymosaic.errors import RegistrationError
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.view import View
from skymosaic.flight.picture.mapping import NOWHERE, MapPlace, north_up, scale_for, usual_magnification
from skymosaic.flight.picture.sharpness import BLURRED, sharpness_ratios
from skymosaic.flight.survey import Flight
from skymosaic.flight.workers import Workers
from skymosaic.geometry.homography import resize_matrix
from skymosaic.imagery.depth import ValueRange, common_range, in_8_bit
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source, decoded

MEMORY_BYTES = 1 << 30
"""Default limit of the decoded photographs a process keeps."""
BAND_REACH_PX = 160
"""Photographs farther than this from a tile do not change it: the margin of the widest band."""
BLURRED_FAVOUR = 1e-3


@dataclass(frozen=True, eq=False)
class Placement:
    """A photograph of a mosaic, not decoded.

    Attributes
    ----------
    source : Source
    size : (int, int)
        Width and height, px.
    transform : ndarray of float64, shape (3, 3)
        Its pixels to pixels of the reference frame.
    tone : Tone
        What makes its intensities agree with those of its neighbours.
    favour : float
        Below 1 for a blurred photograph, which shows only where no other does.
    seam : SeamMask or None
        Part that it may fill.
    """

    source: Source
    size: tuple[int, int]
    transform: Array
    tone: Tone = NEUTRAL
    favour: float = 1.0
    seam: SeamMask | None = None

    def shows_in(self, part: Canvas) -> bool:
        """Whether it shows in a part of the reference frame."""
        shown = footprint(self.size, self.transform).intersection(part)
        return shown is not None and (self.seam is None or self.seam.covers_some_of(shown))


@dataclass(frozen=True, eq=False)
class Composition:
    """A mosaic that is ready to be rendered.

    Attributes
    ----------
    placements : tuple of Placement
        In the order of the layout's members.
    canvas : Canvas
        The part of the reference frame that the mosaic fills.
    coloured : bool
        BGR, or gray where every photograph is gray.
    blending : str
        One of `skymosaic.compositing.blend.METHODS`.
    lens : Lens
    values : ValueRange or None
        The range of photographs of more than 8 bits, one for all; where it is deep, the mosaic has 16 bits.
    place : MapPlace
        On the map; its georeference is that of the canvas's pixels.
    band_names : tuple of str
        Of a multi-band mosaic; else empty.
    aligned_px : dict of str to float
        The median error of the alignment of each band with the registering one, px.
    """

    placements: tuple[Placement, ...]
    canvas: Canvas
    coloured: bool
    blending: str
    lens: Lens
    values: ValueRange | None = None
    place: MapPlace = NOWHERE
    band_names: tuple[str, ...] = ()
    aligned_px: dict[str, float] = field(default_factory=dict)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the canvas, px."""
        return self.canvas.width_px, self.canvas.height_px

    @property
    def transforms(self) -> list[Array]:
        """The transformation of each placement from its pixels to canvas pixels, (3, 3)."""
        return [self.canvas.translation @ placement.transform for placement in self.placements]

    def bands(self, workers: Workers, memory_bytes: int = MEMORY_BYTES) -> Iterator[tuple[Intensities, Mask]]:
        """The picture in bands of at most 1024 rows, from the top, and where they show a photograph; elsewhere 0.

        Raises
        ------
        InputError
            If a photograph can no longer be read.
        """
        tiles = list(self.canvas.tiles())
        calls = [(self.for_tile(tile), tile, memory_bytes) for tile in tiles]
        rendered = zip(tiles, workers.run("mosaic", _render, calls), strict=True)
        for _, row in groupby(rendered, key=lambda item: item[0].y_px):
            pixels, shown = zip(*(tile for _, tile in row), strict=True)
            yield np.concatenate(pixels, axis=1), np.concatenate(shown, axis=1)

    def rendered(self, tile: Canvas, memory_bytes: int) -> tuple[Intensities, Mask]:
        """The pixels of one tile, and where they show a photograph."""
        if not self.placements:
            return self.empty(tile.width_px, tile.height_px), np.zeros((tile.height_px, tile.width_px), np.bool_)
        images = [decoded(memory_bytes).pixels(p.source, self.lens, self.values) for p in self.placements]
        tones = [placement.tone for placement in self.placements]
        layers = layers_of(images, [p.transform for p in self.placements], tones, coloured=self.coloured)
        dressed = [
            replace(layer, favour=p.favour, seam=p.seam, visible=self.lens.visible(layer.size))
            for layer, p in zip(layers, self.placements, strict=True)
        ]
        return blend_layers(dressed, tile, method=self.blending)

    def in_8_bit(self, pixels: Intensities) -> Pixels:
        """Pixels of the mosaic as a picture of 8 bits shows them."""
        return in_8_bit(pixels, self.values)

    def joined(self, bands: Iterable[tuple[Intensities, Mask]]) -> Intensities:
        """The whole picture, (H, W, 3) or (H, W), from its bands; never in memory twice."""
        picture = self.empty(*self.size)
        for index, (band, _) in enumerate(bands):
            picture[index * TILE_PX : index * TILE_PX + len(band)] = band
        return picture

    def empty(self, width_px: int, height_px: int) -> Intensities:
        """A picture without photographs, of the mosaic's type."""
        shape = (height_px, width_px, 3) if self.coloured else (height_px, width_px)
        return np.zeros(shape, np.uint16 if self.values is not None and self.values.deep else np.uint8)

    def changed(self, **values: Sequence[Any]) -> Composition:
        """The composition with new values, one for each placement, of some of their attributes."""
        each = (dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True))
        placements = (replace(p, **new) for p, new in zip(self.placements, each, strict=True))
        return replace(self, placements=tuple(placements))

    def in_own_frame(self) -> Composition:
        """The same with a reference frame whose origin is the canvas's first pixel."""
        moved = self.changed(transform=self.transforms)
        return replace(moved, canvas=Canvas(0, 0, *self.size))

    def for_tile(self, tile: Canvas) -> Composition:
        """The placements that change a tile; some lie beyond its border, because bands reach over it."""
        around = tile.grown(BAND_REACH_PX)
        shown = (p for p in self.placements if p.shows_in(around))
        return replace(self, placements=tuple(shown))


def compose(
    flight: Flight,
    layout: Layout,
    *,
    blending: str = "multiband",
    scale: float = 1.0,
    canvas_limit_px: int = CANVAS_LIMIT_PX,
    equalise: bool = True,
    seams: bool = True,
    own_frame: bool = True,
    place: MapPlace = NOWHERE,
    gsd_m: float | None = None,
) -> Composition:
    """Prepare the picture of one layout: canvas, exposure and seams, from thumbnails alone.

    Parameters
    ----------
    flight : Flight
    layout : Layout
        One of the flight's.
    blending : {"average", "distance", "multiband"}
        As `skymosaic.compositing.blend.blend`.
    scale : float
        Canvas pixels a pixel of the median photograph; of two photographs, a pixel of the right one.
    canvas_limit_px : int
        Largest canvas area that is accepted.
    equalise : bool
        Equalise exposure, and show blurred photographs only where no other shows anything.
    seams : bool
        Cut multi-band blending along seams.
    own_frame : bool
        The canvas begins at (0, 0) of its own frame, in which north is up where there is a map; otherwise it is a
        part of the reference photograph's frame.
    place : MapPlace
        On the map; its georeference is that of the layout's reference frame.
    gsd_m : float or None
        Metres on the ground for each canvas pixel, instead of ``scale``.

    Raises
    ------
    InputError
        For a ``gsd_m`` without a map, or finer than the photographs.
    RegistrationError
        If the canvas would be too large, or a photograph reaches behind the horizon.
    """
    if gsd_m is not None:
        scale = scale_for(flight, layout, place.georeference, gsd_m)
    composition = _arranged(
        flight, layout, blending, scale=scale, canvas_limit_px=canvas_limit_px, place=place, turned=own_frame
    )
    if own_frame:
        composition = composition.in_own_frame()
    if equalise:
        ratios = sharpness_ratios(flight.views, flight.links)[list(layout.members)]
        composition = composition.changed(favour=[BLURRED_FAVOUR if ratio < BLURRED else 1.0 for ratio in ratios])
    views = [flight.views[member] for member in layout.members]
    thumbnails, reduction = thumbnails_of(flight, views, composition)
    if equalise:
        composition = equalised(composition, views, thumbnails)
    if seams and blending == "multiband":
        toned = [replace(layer, tone=p.tone) for layer, p in zip(thumbnails, composition.placements, strict=True)]
        composition = composition.changed(seam=seam_masks(toned, reduction, composition.values))
    return composition


def equalised(composition: Composition, views: Sequence[View], thumbnails: Sequence[Layer]) -> Composition:
    """The composition with tones, and with the range that they need where the photographs have 16 bits.

    Parameters
    ----------
    composition : Composition
    views : sequence of View
        Of its placements.
    thumbnails : sequence of Layer
        From `thumbnails_of`.
    """
    values = composition.values
    if values is None or not values.deep:
        return composition.changed(tone=exposure_tones(thumbnails))
    samples = [view.sample for view in views]
    tones = exposure_tones(thumbnails, camera_levels(samples, [view.taken.black_level for view in views]))
    return replace(composition.changed(tone=tones), values=toned_range(tones, samples, values))


def _arranged(
    flight: Flight,
    layout: Layout,
    blending: str,
    *,
    scale: float,
    canvas_limit_px: int,
    place: MapPlace,
    turned: bool,
) -> Composition:
    """The photographs of a layout on a canvas, in the reference's frame or ``turned`` north up where there is a map."""
    views = [flight.views[member] for member in layout.members]
    if layout.originals is None:
        scale /= usual_magnification(flight, layout)
    on_map = place.georeference
    if on_map is not None and turned:
        to_canvas = north_up(on_map, on_map.metres_a_pixel / scale)
    else:
        to_canvas = resize_matrix(scale)
    transforms = [to_canvas @ transform for transform in layout.to_reference(flight.views).values()]
    try:
        canvas = canvas_of([view.size for view in views], transforms, limit_px=canvas_limit_px)
    except CanvasError as error:
        raise RegistrationError(f"{len(views)} photographs, the first {views[0].name}: {error}") from None
    placements = tuple(
        Placement(flight.sources[member], view.size, transform)
        for member, view, transform in zip(layout.members, views, transforms, strict=True)
    )
    coloured = any(view.thumbnail.ndim == 3 for view in views)
    if on_map is not None:
        on_map = on_map.of(np.asarray(np.linalg.inv(canvas.translation @ to_canvas)))
        place = replace(place, georeference=on_map)
    values = common_range([view.sample for view in views])
    return Composition(placements, canvas, coloured, blending, flight.lens, values, place)


def thumbnails_of(flight: Flight, views: Sequence[View], composition: Composition) -> tuple[list[Layer], float]:
    """The thumbnails of a composition's placements as layers of a reduced canvas, in colour, and the reduction."""
    lens, placements = flight.lens, composition.placements
    widest = max(views, key=lambda view: view.size[0])
    enlarged = float(np.median([magnification(placement.size, placement.transform) for placement in placements]))
    reduction = widest.thumbnail.shape[1] / widest.size[0] / enlarged
    layers = []
    for view, placement in zip(views, placements, strict=True):
        from_thumbnail = view.to_original @ np.linalg.inv(view.to_thumbnail)
        pixels = _shown(view, composition.values)
        layers.append(
            Layer(
                image=pixels,
                transform=resize_matrix(reduction) @ placement.transform @ from_thumbnail,
                visible=lens.visible((view.thumbnail.shape[1], view.thumbnail.shape[0])),
                favour=placement.favour,
            )
        )
    return layers, reduction


def _shown(view: View, values: ValueRange | None) -> Intensities:
    """A thumbnail in colour: with the camera's numbers where the mosaic has 16 bits, else as ``values`` shows it."""
    coloured = view.thumbnail if view.thumbnail.ndim == 3 else cv2.cvtColor(view.thumbnail, cv2.COLOR_GRAY2BGR)
    pixels = np.asarray(coloured, dtype=np.uint8)
    if values is None or view.value_range is None:
        return pixels
    return view.value_range.numbers(pixels) if values.deep else view.value_range.shown_as(pixels, values)


def _render(composition: Composition, tile: Canvas, memory_bytes: int) -> tuple[Intensities, Mask]:
    """The pixels of one tile, and where they show a photograph."""
    return composition.rendered(tile, memory_bytes)
