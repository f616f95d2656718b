"""Renders the mosaic of a layout tile by tile: only the photographs that a tile shows are decoded."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Array, Intensities, Mask, Pixels
from skymosaic.compositing.blend import blend_layers, prepare_layers
from skymosaic.compositing.exposure import estimate_levels, estimate_tones, measure_toned_range
from skymosaic.compositing.layer import Layer, SeamMask
from skymosaic.compositing.seams import find_seams
from skymosaic.compositing.tone import NEUTRAL, Tone
from skymosaic.compositing.warp import (
    CANVAS_LIMIT_PX,
    TILE_PX,
    Canvas,
    CanvasError,
    enclosing_canvas,
    footprint,
    magnification,
    nearness,
    outline,
)
from skymosaic.errors import InputError, RegistrationError
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.view import View
from skymosaic.flight.picture.mapping import NOWHERE, MapPlace, north_up, scale_for, usual_magnification
from skymosaic.flight.survey import BLURRED, Flight
from skymosaic.flight.workers import Workers
from skymosaic.geometry.homography import resize_matrix
from skymosaic.imagery.depth import ValueRange, measure_common_range, show_in_8_bit
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source, decoded_photographs

MEMORY_BYTES = 1 << 30
"""Default limit of the decoded photographs a process keeps."""
BAND_REACH_PX = 160
"""Photographs farther than this from a tile do not change it: the margin of the widest band."""
REMOTE_PERCENTILE = 5
"""Percentile of the nearness of a photograph's ties that counts as its farthest; single ones may be false."""
BEYOND_TIES = 0.63
"""Ground is shown if it is at least this near, relative to the farthest ties: there, pixels are twice as large."""
BLURRED_FAVOUR = 1e-3
"""Weight of a blurred photograph: it loses almost every pixel to a sharp one, and still shows where it is alone."""


@dataclass(frozen=True)
class Room:
    """How large the canvas of a flight may become; a larger one is reduced.

    Attributes
    ----------
    area_px : float
    side_px : int
    reason : str
        What has no more room.
    """

    area_px: float = CANVAS_LIMIT_PX
    side_px: int = 1 << 30
    reason: str = "the whole picture is in memory"

    def share_of(self, canvas: Canvas) -> float:
        """By how much a canvas has to be reduced along its sides, at most 1."""
        longest = max(canvas.width_px, canvas.height_px)
        # Rounding to whole pixels may add one on each side.
        return min(1.0, 0.999 * math.sqrt(self.area_px / canvas.area_px), 0.999 * self.side_px / longest)


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
    least_nearness : float
        Ground farther from the camera is not shown, see `skymosaic.compositing.warp.nearness`; 0 shows all.
    """

    source: Source
    size: tuple[int, int]
    transform: Array
    tone: Tone = NEUTRAL
    favour: float = 1.0
    seam: SeamMask | None = None
    least_nearness: float = 0.0

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
        shown = footprint(self.size, self.transform, self.least_nearness).intersection(part)
        return shown is not None and (self.seam is None or self.seam.touches(shown))


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
    reduced : str
        Why it is smaller than asked for, and what to do; else empty.
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
    reduced: str = ""

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

    def bands(self, workers: Workers, memory_bytes: int = MEMORY_BYTES) -> Iterator[tuple[Intensities, Mask]]:
        """Render the picture in bands of at most 1024 rows from the top, each with a mask of where a photograph shows.

        Raises
        ------
        InputError
            If a photograph can no longer be read.
        """
        tiles = list(self.canvas.tiles())
        calls = [(self.for_tile(tile), tile, memory_bytes) for tile in tiles]
        rendered = zip(tiles, workers.run("mosaic", type(self).render, calls), strict=True)
        for _, row in groupby(rendered, key=lambda item: item[0].y_px):
            pixels, masks = zip(*(tile for _, tile in row), strict=True)
            yield np.concatenate(pixels, axis=1), np.concatenate(masks, axis=1)

    def render(self, tile: Canvas, memory_bytes: int) -> tuple[Intensities, Mask]:
        """Render one tile: its pixels, 0 where no photograph shows, and a mask of where one does."""
        if not self.placements:
            return self.empty(tile.width_px, tile.height_px), np.zeros((tile.height_px, tile.width_px), np.bool_)
        images = [decoded_photographs(memory_bytes).pixels(p.source, self.lens, self.values) for p in self.placements]
        tones = [placement.tone for placement in self.placements]
        plain = prepare_layers(images, [p.transform for p in self.placements], tones, coloured=self.coloured)
        layers = [
            replace(
                layer,
                favour=p.favour,
                seam=p.seam,
                visible=self.lens.visible_mask(layer.size),
                least_nearness=p.least_nearness,
            )
            for layer, p in zip(plain, self.placements, strict=True)
        ]
        return blend_layers(layers, tile, method=self.blending)

    def in_8_bit(self, pixels: Intensities) -> Pixels:
        """Reduce pixels of the mosaic to 8 bits."""
        return show_in_8_bit(pixels, self.values)

    def joined(self, bands: Iterable[tuple[Intensities, Mask]]) -> Intensities:
        """Join the bands of `bands` into one picture, (H, W, 3) or (H, W), which is never in memory twice."""
        picture = self.empty(*self.size)
        for index, (band, _) in enumerate(bands):
            picture[index * TILE_PX : index * TILE_PX + len(band)] = band
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


def compose(
    flight: Flight,
    layout: Layout,
    *,
    blending: str | None = None,
    scale: float = 1.0,
    room: Room | None = None,
    place: MapPlace = NOWHERE,
    gsd_m: float | None = None,
) -> Composition:
    """Prepare the picture of one layout, from thumbnails alone.

    Two photographs are blended as they are, in the frame of the right one. More of them get a canvas that begins at
    (0, 0) of its own frame, in which north is up where there is a map; equal exposure; blurred photographs show only
    where no other does; and multi-band blending is cut along seams.

    Parameters
    ----------
    flight : Flight
    layout : Layout
        One of the flight's.
    blending : {"average", "distance", "multiband"} or None
        See `skymosaic.compositing.blend.blend`. None: distance for two photographs, multiband for more, because
        averages of the ten photographs that may show the same ground are blurred.
    scale : float
        Canvas pixels per pixel of the median photograph; for two photographs, per pixel of the right one.
    room : Room
        What the canvas may become. That of a flight is reduced to it; of two photographs, a larger one is refused.
    place : MapPlace
        Place on the map; its georeference is that of the layout's reference frame.
    gsd_m : float or None
        Metres on the ground per canvas pixel, instead of ``scale``.

    Raises
    ------
    InputError
        For a ``gsd_m`` without a map, or finer than the photographs; for a scale that leaves no pixel of a photograph.
    RegistrationError
        For two photographs, if the canvas would be too large, or one reaches behind the horizon.
    """
    blending = blending or ("multiband" if flight.pair is None else "distance")
    if gsd_m is not None:
        scale = scale_for(flight, layout, place.georeference, gsd_m)
    composition = _place_on_canvas(flight, layout, blending, scale=scale, room=room or Room(), place=place)
    if flight.pair is not None:
        return composition
    sharpness = flight.relative_sharpness[list(layout.members)]
    composition = composition.with_each(favour=[BLURRED_FAVOUR if value < BLURRED else 1.0 for value in sharpness])
    views = [flight.views[member] for member in layout.members]
    # Exposure and seams are smooth, so thumbnails that are in memory already decide both; nothing is decoded here.
    thumbnails, reduction = thumbnail_layers(composition, views)
    composition = equalise(composition, views, thumbnails)
    if blending == "multiband":
        # Seams run where neighbours look alike, so they are cut through thumbnails of equal exposure.
        toned = [replace(layer, tone=p.tone) for layer, p in zip(thumbnails, composition.placements, strict=True)]
        composition = composition.with_each(seam=find_seams(toned, reduction, composition.values))
    return composition


def equalise(composition: Composition, views: Sequence[View], thumbnails: Sequence[Layer]) -> Composition:
    """Set the tones of all placements, and for photographs of 16 bits the value range that the tones need.

    Parameters
    ----------
    composition : Composition
    views : sequence of View
        One for each placement.
    thumbnails : sequence of Layer
        From `thumbnail_layers`.
    """
    values = composition.values
    if values is None or not values.deep:
        return composition.with_each(tone=estimate_tones(thumbnails))
    samples = [view.sample for view in views]
    black, white = estimate_levels(samples, [view.taken.black_level for view in views])
    tones = estimate_tones(thumbnails, black=black, white=white)
    return replace(composition.with_each(tone=tones), values=measure_toned_range(tones, samples, values))


def _place_on_canvas(
    flight: Flight, layout: Layout, blending: str, *, scale: float, room: Room, place: MapPlace
) -> Composition:
    """Lay the photographs of a layout on a canvas, without tones and seams; parameters as of `compose`."""
    views = [flight.views[member] for member in layout.members]
    if scale * max(max(view.size) for view in views) < 1:
        raise InputError("each photograph would be smaller than a pixel; raise --scale, or lower --gsd")
    to_reference = layout.to_reference(flight.views).values()
    is_pair, on_map, usual = flight.pair is not None, place.georeference, usual_magnification(flight, layout)
    least = [0.0] * len(views) if is_pair else least_nearness(flight.views, layout)

    def lay(scale: float) -> tuple[Array, list[Array], Canvas]:
        if on_map is not None and not is_pair:
            to_canvas = north_up(on_map, on_map.metres_per_pixel * usual / scale)
        else:
            to_canvas = resize_matrix(scale / usual)
        transforms = [to_canvas @ transform for transform in to_reference]
        limit_px = room.area_px if is_pair else math.inf
        return to_canvas, transforms, enclosing_canvas([v.size for v in views], transforms, least, limit_px=limit_px)

    try:
        to_canvas, transforms, canvas = lay(scale)
    except CanvasError as error:
        raise RegistrationError(f"{len(views)} photographs, the first {views[0].name}: {error}") from None
    reduced = ""
    if not is_pair and (share := room.share_of(canvas)) < 1:
        full = canvas
        to_canvas, transforms, canvas = lay(scale * share)
        reduced = (
            f"reduced from {full.width_px}x{full.height_px} to {canvas.width_px}x{canvas.height_px} px, because "
            f"{room.reason}; a .tif has room for more, --scale or --canvas-limit choose the size"
        )
    if on_map is not None:
        to_layout = np.asarray(np.linalg.inv(canvas.translation @ to_canvas))
        place = replace(place, georeference=on_map.for_pixels(to_layout))
    if flight.pair is None:
        transforms = [canvas.translation @ transform for transform in transforms]
        canvas = Canvas(0, 0, canvas.width_px, canvas.height_px)
    placements = tuple(
        Placement(flight.sources[member], view.size, transform, least_nearness=nearest)
        for member, view, transform, nearest in zip(layout.members, views, transforms, least, strict=True)
    )
    coloured = any(view.thumbnail.ndim == 3 for view in views)
    values = measure_common_range([view.sample for view in views])
    return Composition(placements, canvas, coloured, blending, flight.lens, values, place, reduced=reduced)


def least_nearness(views: Sequence[View], layout: Layout) -> list[float]:
    """How near ground has to be that each member of a layout shows, see `skymosaic.compositing.warp.nearness`.

    A photograph that looks to the horizon would cover a village with what it shows of the fields behind. Far beyond
    its ties it is coarse, and nothing says whether the ground there is where the layout puts it.
    """
    tied: dict[int, list[Array]] = {member: [] for member in layout.members}
    for link in layout.links:
        tied[link.left].append(link.left_points)
        tied[link.right].append(link.right_points)
    least = []
    for member, points in tied.items():
        if not points:
            least.append(0.0)
            continue
        size, transform = views[member].working_size, layout.transforms[member]
        tied_from = float(np.percentile(nearness(size, transform, np.concatenate(points)), REMOTE_PERCENTILE))
        whole = float(nearness(size, transform, Canvas(0, 0, *size).corners).min())
        least.append(0.0 if whole >= BEYOND_TIES * tied_from else BEYOND_TIES * tied_from)
    return least


def thumbnail_layers(composition: Composition, views: Sequence[View]) -> tuple[list[Layer], float]:
    """The thumbnails of all placements as layers of a reduced canvas, in colour, and the scale of that canvas.

    Parameters
    ----------
    composition : Composition
    views : sequence of View
        One for each placement.
    """
    # The canvas is reduced as the widest photograph is, so that hardly any thumbnail is enlarged.
    widest = max(views, key=lambda view: view.size[0])
    enlarged = float(np.median([magnification(p.size, p.transform) for p in composition.placements]))
    reduction = widest.thumbnail.shape[1] / widest.size[0] / enlarged
    layers = []
    for view, placement in zip(views, composition.placements, strict=True):
        from_thumbnail = view.to_original @ np.linalg.inv(view.to_thumbnail)
        layers.append(
            Layer(
                image=_coloured_thumbnail(view, composition.values),
                transform=resize_matrix(reduction) @ placement.transform @ from_thumbnail,
                visible=composition.lens.visible_mask((view.thumbnail.shape[1], view.thumbnail.shape[0])),
                # Thumbnails have the same size, whatever detail their photographs show.
                favour=placement.favour * view.size[0] / view.thumbnail.shape[1],
                least_nearness=placement.least_nearness,
            )
        )
    return layers, reduction


def _coloured_thumbnail(view: View, values: ValueRange | None) -> Intensities:
    """A thumbnail in colour: with the camera's numbers where the mosaic has 16 bits, else as ``values`` shows it."""
    coloured = view.thumbnail if view.thumbnail.ndim == 3 else cv2.cvtColor(view.thumbnail, cv2.COLOR_GRAY2BGR)
    pixels = np.asarray(coloured, dtype=np.uint8)
    if values is None or view.value_range is None:
        return pixels
    return view.value_range.to_16_bit(pixels) if values.deep else view.value_range.show_as(pixels, values)
