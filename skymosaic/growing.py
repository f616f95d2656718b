"""A mosaic that grows photograph by photograph; what was painted stays, the photographs themselves are not kept."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from skymosaic.images import Pixels
from skymosaic.warp import CANVAS_LIMIT_PX, Canvas, backward, canvas_of, footprint, shrunk

Array = NDArray[np.float64]

FEATHER_PX = 16
"""Width over which one photograph fades into the other."""
SPARE_ROOM = 0.15
"""Share of the mosaic's size that is allocated beyond each side, so that growing seldom copies."""
GAIN_LIMITS = (0.75, 1.33)


class GrowingCanvas:
    """Photographs painted on top of each other, each shown where its own border is farther away than the others'.

    Beside the colours, one distance a pixel is kept: 7 bytes a pixel in all.

    Parameters
    ----------
    limit_px : int
        Largest area of the mosaic.

    Attributes
    ----------
    extent : Canvas or None
        The smallest rectangle of the reference frame that holds everything painted; None before the first.
    """

    def __init__(self, limit_px: int = CANVAS_LIMIT_PX) -> None:
        self.extent: Canvas | None = None
        self._limit_px = limit_px
        self._room = Canvas(0, 0, 0, 0)
        self._pixels = np.zeros((0, 0, 3), np.uint8)
        self._distance = np.zeros((0, 0), np.float32)

    def paint(self, picture: Pixels, transform: Array, mask: Pixels | None = None) -> None:
        """Paint a picture, (H, W) or (H, W, 3) BGR, that ``transform`` maps to the reference frame.

        Its brightness is matched to what it meets. Where ``mask`` (H, W) is 0 it shows nothing.

        Raises
        ------
        CanvasError
            If the canvas would exceed its limit, or the picture reaches behind the camera; nothing has changed.
        """
        size = picture.shape[1], picture.shape[0]
        self._reserve(size, transform)
        part = footprint(size, transform)
        where = part.within(self._room)
        new = _warped(picture if picture.ndim == 3 else cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), transform, part)
        new_distance = _distance(np.full(picture.shape[:2], 255, np.uint8) if mask is None else mask, transform, part)
        old, old_distance = self._pixels[where], self._distance[where]
        new *= _gain(old, new, (old_distance > 0) & (new_distance > 0))
        share = np.clip((new_distance - old_distance) / FEATHER_PX + 0.5, 0, 1)
        share[old_distance == 0] = 1
        share[new_distance == 0] = 0
        self._pixels[where] = np.rint(np.clip(old + share[..., None] * (new - old), 0, 255)).astype(np.uint8)
        np.maximum(old_distance, new_distance, out=old_distance)

    @property
    def to_image(self) -> Array:
        """The reference frame's pixels to those of `image`, (3, 3)."""
        return np.eye(3) if self.extent is None else self.extent.translation

    @property
    def image(self) -> Pixels:
        """What was painted, (H, W, 3) uint8; 0 where nothing was."""
        if self.extent is None:
            return self._pixels
        return self._pixels[self.extent.within(self._room)]

    @property
    def mask(self) -> Pixels:
        """255 where something was painted on `image`, else 0, (H, W)."""
        distance = self._distance if self.extent is None else self._distance[self.extent.within(self._room)]
        return np.asarray(distance > 0, dtype=np.uint8) * np.uint8(255)

    def _reserve(self, size: tuple[int, int], transform: Array) -> None:
        """Make room for a photograph, and some to spare where the allocated room is too small."""
        sizes, transforms, old = [size], [transform], self.extent
        if old is not None:
            sizes.append((old.width_px, old.height_px))
            transforms.append(np.asarray(np.linalg.inv(old.translation), dtype=np.float64))
        self.extent = canvas_of(sizes, transforms, limit_px=self._limit_px)
        if self._room.intersection(self.extent) == self.extent:
            return
        spare_x, spare_y = round(SPARE_ROOM * self.extent.width_px), round(SPARE_ROOM * self.extent.height_px)
        room = Canvas(
            self.extent.x_px - spare_x,
            self.extent.y_px - spare_y,
            self.extent.width_px + 2 * spare_x,
            self.extent.height_px + 2 * spare_y,
        )
        pixels = np.zeros((room.height_px, room.width_px, 3), np.uint8)
        distance = np.zeros(pixels.shape[:2], np.float32)
        if old is not None:
            pixels[old.within(room)] = self._pixels[old.within(self._room)]
            distance[old.within(room)] = self._distance[old.within(self._room)]
        self._room, self._pixels, self._distance = room, pixels, distance


def _warped(picture: Pixels, transform: Array, part: Canvas) -> NDArray[np.float32]:
    return backward(*shrunk(picture, transform), part, border=cv2.BORDER_REPLICATE).astype(np.float32)


def _distance(mask: Pixels, transform: Array, part: Canvas) -> NDArray[np.float32]:
    """Distance of each pixel of a part of the reference frame to the next that the picture does not show."""
    shown = np.asarray(backward(*shrunk(mask, transform), part) == 255, dtype=np.uint8)
    # What lies around the part shows nothing either.
    framed = cv2.copyMakeBorder(shown, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    return np.asarray(cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1], dtype=np.float32)


def _gain(old: Pixels, new: NDArray[np.float32], common: NDArray[np.bool_]) -> float:
    """Factor that gives the new pixels the mean of the old ones where they meet."""
    if not common.any():
        return 1.0
    return float(np.clip(old[common].mean() / max(new[common].mean(), 1.0), *GAIN_LIMITS))
