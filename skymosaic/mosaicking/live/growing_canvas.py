"""A mosaic to which photographs are added one by one. They are not kept, so painted pixels can only be moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Mask, Pixels
from skymosaic.compositing.warp import CANVAS_LIMIT_PX, Canvas, enclosing_canvas, footprint, shrink, warp_backward

FEATHER_PX = 16
"""Width over which one photograph fades into the other."""
UNPAINTED = -1
"""Stored instead of a photograph's number in pixels that no photograph covers."""
SPARE_ROOM = 0.15
"""Share of the mosaic's size that is allocated beyond each side, so that growth rarely has to copy the canvas."""
GAIN_LIMITS = (0.5, 2.0)
"""Limits of the factor that matches the brightness of two photographs."""


class GrowingCanvas:
    """Photographs painted on top of each other; each pixel shows the one whose border is farthest away.

    Each pixel stores its colour, the distance from that border and the photograph's number, 11 bytes in all.

    Parameters
    ----------
    limit_px : int
        Largest area of the mosaic.

    Attributes
    ----------
    extent : Canvas or None
        The smallest rectangle of the reference frame that contains all photographs; None before the first.
    """

    def __init__(self, limit_px: int = CANVAS_LIMIT_PX) -> None:
        self.extent: Canvas | None = None
        self._limit_px = limit_px
        self._room = Canvas(0, 0, 0, 0)
        self._pixels = np.zeros((0, 0, 3), np.uint8)
        self._distance = np.zeros((0, 0), np.float32)
        self._number = np.zeros((0, 0), np.int32)

    def paint(self, picture: Pixels, transform: Array, number: int) -> None:
        """Paint a photograph; where it overlaps others, the brighter side is darkened to match.

        Parameters
        ----------
        picture : ndarray of uint8, shape (H, W) or (H, W, 3) BGR
        transform : ndarray, shape (3, 3)
            Its pixels to the reference frame.
        number : int
            Number of the photograph, from 0.

        Raises
        ------
        CanvasError
            If the canvas would exceed its limit, or the picture extends behind the camera; nothing has changed then.
        """
        coloured = picture if picture.ndim == 3 else cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
        everywhere = np.full(picture.shape[:2], 255, np.uint8)
        self._paint([_Part(np.asarray(coloured, dtype=np.uint8), everywhere, transform, number)], matching=True)

    def take_over(self, other: GrowingCanvas, motions: Mapping[int, Array], *, matching: bool) -> None:
        """Paint the pixels of another canvas, each photograph's moved by a transformation of the reference frame.

        Parameters
        ----------
        other : GrowingCanvas
        motions : mapping of int to (3, 3) ndarray
            Transformation for each photograph's number; photographs without one are left out.
        matching : bool
            Whether brightness is matched in overlaps, as in `paint`.

        Raises
        ------
        CanvasError
            As in `paint`.
        """
        kernel = np.ones((2 * FEATHER_PX + 1, 2 * FEATHER_PX + 1), np.uint8)
        bounds = Canvas(0, 0, other._room.width_px, other._room.height_px)
        parts = []
        for number, motion in motions.items():
            own = np.asarray(other._number == number, dtype=np.uint8)
            x, y, width, height = cv2.boundingRect(own)
            if width == 0:
                continue
            # A margin of the neighbouring pixels is moved too, so that seams fade as before and no gaps open.
            margin = Canvas(x - FEATHER_PX, y - FEATHER_PX, width + 2 * FEATHER_PX, height + 2 * FEATHER_PX)
            around = margin.intersection(bounds) or bounds
            where = around.within(bounds)
            mask = cv2.dilate(own[where], kernel) * (other._distance[where] > 0) * np.uint8(255)
            x, y, width, height = cv2.boundingRect(mask)
            inner = slice(y, y + height), slice(x, x + width)
            corner = np.linalg.inv(around.translation @ other._room.translation) @ Canvas(-x, -y, 0, 0).translation
            picture = other._pixels[where][inner]
            parts.append(_Part(picture, np.asarray(mask[inner], dtype=np.uint8), motion @ corner, number))
        self._paint(parts, matching=matching)

    @property
    def to_image(self) -> Array:
        """Pixels of the reference frame to pixels of `image`, (3, 3)."""
        return np.eye(3) if self.extent is None else self.extent.translation

    @property
    def image(self) -> Pixels:
        """The painted pixels, (H, W, 3) uint8 BGR; 0 where there is none."""
        if self.extent is None:
            return self._pixels
        return self._pixels[self.extent.within(self._room)]

    @property
    def shown(self) -> Mask:
        """Where `image` shows a photograph, (H, W)."""
        if self.extent is None:
            return np.zeros((0, 0), np.bool_)
        return np.asarray(self._distance[self.extent.within(self._room)] > 0)

    def _darken(self, divisor: Float32) -> None:
        """Divide all channels (3,) of the mosaic by ``divisor``."""
        if (divisor > 1).any():
            levels = np.arange(256)[:, None] / divisor
            cv2.LUT(self._pixels, np.rint(levels).astype(np.uint8)[None], dst=self._pixels)

    def _paint(self, parts: Sequence[_Part], *, matching: bool) -> None:
        # First of all the room, which may be refused: until then nothing has changed.
        self._reserve(parts)
        for picture, mask, transform, number in parts:
            covered = footprint((picture.shape[1], picture.shape[0]), transform)
            where = covered.within(self._room)
            new = warp_backward(*shrink(picture, transform), covered, border=cv2.BORDER_REPLICATE).astype(np.float32)
            new_distance = _distance(mask, transform, covered)
            old, old_distance = self._pixels[where], self._distance[where]
            if matching:
                gain = _gain(old, new, (old_distance > 0) & (new_distance > 0))
                # The darker side is never brightened, because saturated pixels cannot be corrected that way.
                new *= np.minimum(gain, 1)
                self._darken(np.maximum(gain, 1))
            share = np.clip((new_distance - old_distance) / FEATHER_PX + 0.5, 0, 1)
            share[old_distance == 0] = 1
            share[new_distance == 0] = 0
            self._pixels[where] = np.rint(np.clip(old + share[..., None] * (new - old), 0, 255)).astype(np.uint8)
            self._number[where][new_distance > old_distance] = number
            np.maximum(old_distance, new_distance, out=old_distance)

    def _reserve(self, parts: Sequence[_Part]) -> None:
        """Extend the canvas to hold the pictures; allocate more than needed where it has to grow."""
        sizes = [(part.picture.shape[1], part.picture.shape[0]) for part in parts]
        transforms, old = [part.transform for part in parts], self.extent
        if old is not None:
            sizes.append((old.width_px, old.height_px))
            transforms.append(np.asarray(np.linalg.inv(old.translation), dtype=np.float64))
        self.extent = enclosing_canvas(sizes, transforms, limit_px=self._limit_px)
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
        number = np.full(pixels.shape[:2], UNPAINTED, np.int32)
        if old is not None:
            pixels[old.within(room)] = self._pixels[old.within(self._room)]
            distance[old.within(room)] = self._distance[old.within(self._room)]
            number[old.within(room)] = self._number[old.within(self._room)]
        self._room, self._pixels, self._distance, self._number = room, pixels, distance, number


class _Part(NamedTuple):
    """A picture (H, W, 3), its mask (H, W; 255 where valid), its transformation to the reference frame, its number."""

    picture: Pixels
    mask: Pixels
    transform: Array
    number: int


def _distance(mask: Pixels, transform: Array, part: Canvas) -> Float32:
    """Distance of each pixel in a part of the reference frame to the nearest pixel that the picture does not cover."""
    covered = np.asarray(warp_backward(*shrink(mask, transform), part) == 255, dtype=np.uint8)
    # The pixels around the part count as not covered, too.
    framed = cv2.copyMakeBorder(covered, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    return np.asarray(cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1], dtype=np.float32)


def _gain(old: Pixels, new: Float32, common: Mask) -> Float32:
    """Factors (3,) that give the new pixels the channel means of the old ones where both cover the canvas."""
    if not common.any():
        return np.ones(3, dtype=np.float32)
    gain = old[common].mean(axis=0) / np.maximum(new[common].mean(axis=0), 1)
    return np.asarray(np.clip(gain, *GAIN_LIMITS), dtype=np.float32)
