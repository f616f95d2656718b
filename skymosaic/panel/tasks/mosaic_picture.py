"""What the page shows of a mosaic, made in a worker: a picture, tiles for deeper zoom, outlines and seams."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.output import Delivery
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import save
from skymosaic.panel.pair_view import Size
from skymosaic.panel.results import ShownMosaic, Tile

PREVIEW_WIDTH_PX = 8192
"""Mosaics up to this width are shown in full by tiles; wider ones are reduced to it."""
PICTURE_SIDE_PX = 3000
"""Longest side of the picture below the tiles."""
TILE_PX = 512
OVERLAP_PX = 1
"""Tiles overlap, otherwise a browser shows lines between them."""
SEAM_ERROR_PX = 0.7
"""Seams are simplified by so much, in pixels of their masks."""


def show_mosaic(delivery: Delivery, views: Path, name: str) -> ShownMosaic:
    """Save the pictures of a mosaic for the page.

    Parameters
    ----------
    delivery : Delivery
        With a preview of at most `PREVIEW_WIDTH_PX`.
    views : Path
        Their folder.
    name : str
        Their names begin with it. Browsers cache what they have shown, so each run has its own.
    """
    composition = delivery.composition
    picture = page_picture(delivery.preview)
    path, shown = views / f"{name}.jpg", (picture.shape[1], picture.shape[0])
    save(path, picture)
    scale = shown[0] / composition.size[0]
    return ShownMosaic(
        picture=path,
        size=composition.size,
        shown_size=shown,
        outlines={each: corners * scale for each, corners in outlines(composition).items()},
        seams=tuple(line * scale for line in _seams(composition)),
        tiles=tuple(_tiles(delivery.preview, shown, views, name)),
    )


def page_picture(preview: Pixels) -> Pixels:
    """A mosaic, reduced to `PICTURE_SIDE_PX`."""
    scale = PICTURE_SIDE_PX / max(preview.shape[:2])
    return preview if scale >= 1 else _reduced(preview, scale)


def outlines(composition: Composition) -> dict[str, Array]:
    """The corners of the photographs on the canvas, (4, 2), by name."""
    return {
        placement.source.name: apply(transform, _frame(placement.size))
        for placement, transform in zip(composition.placements, composition.transforms, strict=True)
    }


def _frame(size: Size) -> Array:
    width, height = size
    return np.array([(0, 0), (width, 0), (width, height), (0, height)]) - 0.5


def _seams(composition: Composition) -> Iterator[Array]:
    """Closed lines (N, 2) on the canvas around what each photograph shows; none where they are blended throughout."""
    for placement in composition.placements:
        seam = placement.seam
        if seam is None:
            continue
        lines, _ = cv2.findContours(seam.mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        corner = seam.canvas.x_px, seam.canvas.y_px
        for line in lines:
            simple = cv2.approxPolyDP(line, SEAM_ERROR_PX, closed=True)[:, 0] + corner
            if len(simple) > 2:
                # From pixel centres of the reduced frame to those of the reference frame.
                yield apply(composition.canvas.translation, (simple + 0.5) / seam.scale - 0.5)


def _tiles(preview: Pixels, shown: Size, views: Path, name: str) -> Iterator[Tile]:
    """Tiles of every size between the preview and the picture, saved."""
    level, number = preview, 0
    while level.shape[1] > shown[0]:
        scale = shown[0] / level.shape[1]
        for y in range(0, level.shape[0], TILE_PX):
            for x in range(0, level.shape[1], TILE_PX):
                pixels = level[y : y + TILE_PX + OVERLAP_PX, x : x + TILE_PX + OVERLAP_PX]
                path = views / f"{name}-{number}-{x}-{y}.jpg"
                save(path, pixels)
                yield Tile(path, scale, x * scale, y * scale, pixels.shape[1] * scale, pixels.shape[0] * scale)
        level, number = _reduced(level, 0.5), number + 1


def _reduced(pixels: Pixels, scale: float) -> Pixels:
    size = max(round(pixels.shape[1] * scale), 1), max(round(pixels.shape[0] * scale), 1)
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
