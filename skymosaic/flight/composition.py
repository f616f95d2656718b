"""The picture of a laid-out flight, tile by tile: only the photographs that a tile shows are decoded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.compositing.blend import blend_layers, layers_of
from skymosaic.compositing.exposure import exposure_gains
from skymosaic.compositing.layer import Layer, SeamMask
from skymosaic.compositing.seams import seam_masks
from skymosaic.compositing.warp import (
    CANVAS_LIMIT_PX,
    TILE_PX,
    Canvas,
    CanvasError,
    canvas_of,
    footprint,
)
from skymosaic.errors import RegistrationError
from skymosaic.flight.layout import Layout
from skymosaic.flight.sharpness import BLURRED, sharpness_ratios
from skymosaic.flight.survey import Flight
from skymosaic.flight.view import View
from skymosaic.flight.workers import Workers
from skymosaic.geometry.homography import resize_matrix
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import DecodedPhotographs, Source

MEMORY_BYTES = 1 << 30
"""Default limit of the decoded photographs a process keeps."""
BAND_REACH_PX = 160
"""Beyond this distance from a tile no photograph changes it: the margin of the widest band."""
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
        Its pixels to canvas pixels.
    gain : tuple of float
        Factor on its intensities, by channel.
    favour : float
        Below 1 for a blurred one, which shows only where no other does.
    seam : SeamMask or None
        Where seams let it show.
    """

    source: Source
    size: tuple[int, int]
    transform: Array
    gain: tuple[float, ...] = (1.0,)
    favour: float = 1.0
    seam: SeamMask | None = None

    def shows_in(self, part: Canvas) -> bool:
        """Whether it shows in a part of the canvas."""
        shown = footprint(self.size, self.transform).intersection(part)
        return shown is not None and (self.seam is None or self.seam.covers_some_of(shown))


@dataclass(frozen=True, eq=False)
class Composition:
    """All that the picture of one layout is made from.

    Attributes
    ----------
    placements : tuple of Placement
        In the order of the layout's members.
    size : (int, int)
        Width and height of the canvas, px.
    coloured : bool
        BGR, or gray where every photograph is gray.
    blending : str
        One of `skymosaic.compositing.blend.METHODS`.
    lens : Lens
    """

    placements: tuple[Placement, ...]
    size: tuple[int, int]
    coloured: bool
    blending: str
    lens: Lens

    def bands(self, workers: Workers, memory_bytes: int = MEMORY_BYTES) -> Iterator[Pixels]:
        """The picture in bands of at most 1024 whole rows, from the top; pixels that nothing shows are 0.

        Raises
        ------
        InputError
            If a photograph can no longer be read.
        """
        tiles = list(Canvas(0, 0, *self.size).tiles())
        calls = [(self._for_tile(tile), tile, memory_bytes) for tile in tiles]
        rendered = zip(tiles, workers.run("mosaic", _render, calls), strict=True)
        for _, row in groupby(rendered, key=lambda item: item[0].y_px):
            yield np.concatenate([pixels for _, pixels in row], axis=1)

    def image(self, workers: Workers, memory_bytes: int = MEMORY_BYTES) -> Pixels:
        """The whole picture, (H, W, 3) or (H, W)."""
        channels = (3,) if self.coloured else ()
        picture = np.empty((self.size[1], self.size[0], *channels), dtype=np.uint8)
        for index, band in enumerate(self.bands(workers, memory_bytes)):
            picture[index * TILE_PX : index * TILE_PX + len(band)] = band
        return picture

    def _for_tile(self, tile: Canvas) -> Composition:
        """What may show in a tile, bands that reach over its border included."""
        around = replace(
            tile,
            x_px=tile.x_px - BAND_REACH_PX,
            y_px=tile.y_px - BAND_REACH_PX,
            width_px=tile.width_px + 2 * BAND_REACH_PX,
            height_px=tile.height_px + 2 * BAND_REACH_PX,
        )
        shown = (p for p in self.placements if p.shows_in(around))
        return replace(self, placements=tuple(shown))


def compose(
    flight: Flight,
    layout: Layout,
    *,
    blending: str = "multiband",
    scale: float = 1.0,
    canvas_limit_px: int = CANVAS_LIMIT_PX,
) -> Composition:
    """Prepare the picture of one layout: canvas, exposure gains and seams, from thumbnails alone.

    Parameters
    ----------
    flight : Flight
    layout : Layout
        One of its.
    blending : {"average", "distance", "multiband"}
        As `skymosaic.compositing.blend.blend`; multiband along seams.
    scale : float
        Canvas pixels a pixel of the reference photograph.
    canvas_limit_px : int
        Largest canvas area that is accepted.

    Raises
    ------
    RegistrationError
        If the canvas would be too large, or a photograph reaches behind the horizon.
    """
    views = [flight.views[member] for member in layout.members]
    to_reference = resize_matrix(scale) @ flight.views[layout.reference].to_original
    transforms = [
        to_reference @ layout.transforms[member] @ np.linalg.inv(view.to_original)
        for member, view in zip(layout.members, views, strict=True)
    ]
    try:
        canvas = canvas_of([view.size for view in views], transforms, limit_px=canvas_limit_px)
    except CanvasError as error:
        raise RegistrationError(f"{len(views)} photographs from {views[0].name} on: {error}") from None
    ratios = sharpness_ratios(flight.views, flight.links)
    placements = [
        Placement(
            source=flight.sources[member],
            size=view.size,
            transform=canvas.translation @ transform,
            favour=BLURRED_FAVOUR if ratios[member] < BLURRED else 1.0,
        )
        for member, view, transform in zip(layout.members, views, transforms, strict=True)
    ]
    coloured = any(view.thumbnail.ndim == 3 for view in views)
    lens = flight.settings.lens
    thumbnails, reduction = _thumbnails(views, placements, lens, scale)
    gains = _gains(thumbnails)
    placements = [replace(p, gain=tuple(gain.tolist())) for p, gain in zip(placements, gains, strict=True)]
    if blending == "multiband":
        toned = [replace(layer, gain=p.gain) for layer, p in zip(thumbnails, placements, strict=True)]
        seams = seam_masks(toned, reduction)
        placements = [replace(p, seam=seam) for p, seam in zip(placements, seams, strict=True)]
    return Composition(tuple(placements), (canvas.width_px, canvas.height_px), coloured, blending, lens)


def _thumbnails(
    views: Sequence[View], placements: Sequence[Placement], lens: Lens, scale: float
) -> tuple[list[Layer], float]:
    """The thumbnails on a canvas reduced to about their size, in colour, and that reduction."""
    widest = max(views, key=lambda view: view.size[0])
    reduction = widest.thumbnail.shape[1] / widest.size[0] / scale
    layers = []
    for view, placement in zip(views, placements, strict=True):
        from_thumbnail = view.to_original @ np.linalg.inv(view.to_thumbnail)
        pixels = view.thumbnail if view.thumbnail.ndim == 3 else cv2.cvtColor(view.thumbnail, cv2.COLOR_GRAY2BGR)
        layers.append(
            Layer(
                image=np.asarray(pixels, dtype=np.uint8),
                transform=resize_matrix(reduction) @ placement.transform @ from_thumbnail,
                visible=lens.visible((view.thumbnail.shape[1], view.thumbnail.shape[0])),
                favour=placement.favour,
            )
        )
    return layers, reduction


def _gains(thumbnails: Sequence[Layer]) -> Array:
    """Exposure gains by channel, (N, 3)."""
    transforms = [layer.transform for layer in thumbnails]
    canvas = canvas_of([layer.size for layer in thumbnails], transforms)
    channels = [[layer.image[..., channel] for layer in thumbnails] for channel in range(3)]
    return np.stack([exposure_gains(images, transforms, canvas) for images in channels], axis=1)


@lru_cache(maxsize=1)
def _decoded(limit_bytes: int) -> DecodedPhotographs:
    """The photographs this process has decoded."""
    return DecodedPhotographs(limit_bytes)


def _render(composition: Composition, tile: Canvas, memory_bytes: int) -> Pixels:
    """The pixels of one tile."""
    placements, lens = composition.placements, composition.lens
    if not placements:
        channels = (3,) if composition.coloured else ()
        return np.zeros((tile.height_px, tile.width_px, *channels), dtype=np.uint8)
    images = [_decoded(memory_bytes).pixels(placement.source, lens) for placement in placements]
    gains = np.array([placement.gain for placement in placements])
    layers = layers_of(images, [placement.transform for placement in placements], gains, coloured=composition.coloured)
    dressed = [
        replace(layer, favour=placement.favour, seam=placement.seam, visible=lens.visible(layer.size))
        for layer, placement in zip(layers, placements, strict=True)
    ]
    return blend_layers(dressed, tile, method=composition.blending)
