"""Draws what the page shows of a mosaic, in a worker: a picture, tiles for deeper zoom, outlines and seams."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.output import Delivery
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import save
from skymosaic.panel.results import Picture, ShownMosaic, Size, picture_address
from skymosaic.reports.footprints import outline_photographs

PREVIEW_WIDTH_PX = 8192
"""Mosaics up to this width are shown in full by tiles; wider ones are reduced to it."""
PICTURE_SIDE_PX = 3000
"""Longest side of the picture below the tiles."""
TILE_PX = 512
OVERLAP_PX = 1
"""Tiles overlap, otherwise a browser shows lines between them."""
SEAM_ERROR_PX = 0.7
"""Simplified seams deviate by at most this, in pixels of their masks."""


def show_mosaic(delivery: Delivery, pictures: Path) -> ShownMosaic:
    """Save the pictures of a mosaic in the folder ``pictures``; the delivery's preview has `PREVIEW_WIDTH_PX`."""
    composition = delivery.composition
    reduction = PICTURE_SIDE_PX / max(delivery.preview.shape[:2])
    picture = delivery.preview if reduction >= 1 else _resize(delivery.preview, reduction)
    path, shown = pictures / "mosaic.jpg", (picture.shape[1], picture.shape[0])
    save(path, picture)
    scale = shown[0] / composition.size[0]
    names = [placement.source.name for placement in composition.placements]
    return ShownMosaic(
        picture=Picture(picture_address(path), *shown),
        size=composition.size,
        outlines={name: corners * scale for name, corners in zip(names, outline_photographs(composition), strict=True)},
        seams=tuple(line * scale for line in _seams(composition)),
        tiles=tuple(_save_tiles(delivery.preview, shown, pictures)),
    )


def _seams(composition: Composition) -> Iterator[Array]:
    """Closed lines (N, 2) on the canvas around what each photograph shows; none where they are blended throughout."""
    for placement in composition.placements:
        seam = placement.seam
        if seam is None:
            continue
        lines, _ = cv2.findContours(seam.mask.pixels, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        corner = seam.canvas.x_px, seam.canvas.y_px
        for line in lines:
            simple = cv2.approxPolyDP(line, SEAM_ERROR_PX, closed=True)[:, 0] + corner
            if len(simple) > 2:
                # From pixel centres of the reduced frame to those of the reference frame.
                yield apply(composition.canvas.translation, (simple + 0.5) / seam.scale - 0.5)


def _save_tiles(preview: Pixels, shown: Size, pictures: Path) -> Iterator[Picture]:
    """Save tiles of every size between the preview and the picture."""
    level, number = preview, 0
    while level.shape[1] > shown[0]:
        scale = shown[0] / level.shape[1]
        for y in range(0, level.shape[0], TILE_PX):
            for x in range(0, level.shape[1], TILE_PX):
                pixels = level[y : y + TILE_PX + OVERLAP_PX, x : x + TILE_PX + OVERLAP_PX]
                path = pictures / f"tile-{number}-{x}-{y}.jpg"
                save(path, pixels)
                size = pixels.shape[1] * scale, pixels.shape[0] * scale
                yield Picture(picture_address(path), *size, x * scale, y * scale, scale)
        level, number = _resize(level, 0.5), number + 1


def _resize(pixels: Pixels, scale: float) -> Pixels:
    size = max(round(pixels.shape[1] * scale), 1), max(round(pixels.shape[0] * scale), 1)
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
