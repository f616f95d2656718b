"""One photograph as a layer of a mosaic: its warped pixels, and how strongly it claims each of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Mask, Pixels
from skymosaic.compositing.warp import Canvas, backward, footprint, source_window, warp_tile
from skymosaic.geometry.homography import apply, resize_matrix

SMALLEST_WEIGHT = 1e-3
"""Weight of a pixel on the image's own border: it counts only where no other image shows anything."""


@dataclass(frozen=True, eq=False)
class SeamMask:
    """Where seams let a photograph show, on a reduced canvas.

    Attributes
    ----------
    mask : ndarray of uint8, shape (h, w)
        255 where it does, else 0.
    canvas : Canvas
        What the mask covers of the reduced reference frame.
    scale : float
        Size of the reduced frame against the reference frame.
    """

    mask: Pixels
    canvas: Canvas
    scale: float

    def covers_some_of(self, part: Canvas) -> bool:
        """Whether anything shows in ``part`` of the reference frame, or close by."""
        first, last = apply(self._to_mask, part.corners[[0, 2]])
        x, y = np.maximum(np.floor(first) - 1, 0).astype(int)
        last_x, last_y = np.maximum(np.ceil(last) + 2, 0).astype(int)
        return bool(self.mask[y:last_y, x:last_x].any())

    def share(self, part: Canvas) -> Pixels:
        """The mask enlarged to ``part`` of the reference frame, 0..255; seams become smooth lines."""
        matrix = self._to_mask @ np.linalg.inv(part.translation)
        size = (part.width_px, part.height_px)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        enlarged = cv2.warpAffine(self.mask, matrix[:2], size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(enlarged, dtype=np.uint8)

    @property
    def _to_mask(self) -> Array:
        return self.canvas.translation @ resize_matrix(self.scale)


@dataclass(frozen=True, eq=False)
class Layer:
    """A photograph with its transformation to the reference frame.

    Attributes
    ----------
    image : ndarray of uint8, shape (H, W) or (H, W, 3)
    transform : ndarray of float64, shape (3, 3)
        Its pixels to reference pixels.
    gain : tuple of float
        Factor on its intensities, one or one a channel.
    visible : ndarray of uint8, shape (H, W), or None
        255 where it shows the ground, else 0; None: everywhere.
    favour : float
        Factor on its claim: below 1 for a photograph that should show only where others do not.
    seam : SeamMask or None
        Where seams let it show; None: wherever it is the farthest from its border.
    """

    image: Pixels
    transform: Array
    gain: tuple[float, ...] = (1.0,)
    visible: Pixels | None = None
    favour: float = 1.0
    seam: SeamMask | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        return self.image.shape[1], self.image.shape[0]

    def part_of(self, canvas: Canvas) -> Canvas | None:
        """The part of the canvas that the image may touch."""
        return footprint(self.size, self.transform).intersection(canvas)

    def shown_part_of(self, canvas: Canvas) -> Canvas | None:
        """The same, or None where seams let it show nowhere there."""
        part = self.part_of(canvas)
        return part if part is None or self.seam is None or self.seam.covers_some_of(part) else None

    def pixels(self, part: Canvas) -> Pixels:
        """The warped intensities times the gain; beyond the border, the border's."""
        warped = backward(self.image, self.transform, part, border=cv2.BORDER_REPLICATE)
        if all(gain == 1 for gain in self.gain):
            return warped
        # OpenCV takes a scalar of four channels; one gain serves them all.
        factors = (self.gain * 4 if len(self.gain) == 1 else (*self.gain, 0.0))[:4]
        return np.asarray(cv2.multiply(warped, np.array(factors)), dtype=np.uint8)

    def border_distance(self, part: Canvas) -> Float32:
        """Distance from each pixel to the border of what the image shows, in its own pixels; 0 outside."""
        source = source_window(self.size, self.transform, part)
        plus_one = warp_tile(self._plus_one(source), self.transform, source, part, cv2.BORDER_CONSTANT)
        inside = plus_one > 1 - SMALLEST_WEIGHT
        return np.where(inside, np.maximum(plus_one - 1, SMALLEST_WEIGHT), 0).astype(np.float32)

    def claim(self, part: Canvas) -> Float32:
        """Who claims a pixel most shows it: by the seams, or else by the distance from the border; 0 outside."""
        if self.seam is None:
            return self.border_distance(part) * np.float32(self.favour)
        # Where every seam says no, between two masks or beyond the last, any image that covers the pixel will do.
        share = np.maximum(self.seam.share(part), 1)
        return np.where(self._covers(part), share, 0).astype(np.float32)

    def _covers(self, part: Canvas) -> Mask:
        whole = np.full(self.image.shape[:2], 255, np.uint8) if self.visible is None else self.visible
        return np.asarray(backward(whole, self.transform, part) == 255)

    def _plus_one(self, source: Canvas) -> Float32:
        """One more than the distance, in a window of the image: what falls below 1 is mixed with the outside."""
        if self._masked_distance is not None:
            return self._masked_distance[source.within(Canvas(0, 0, *self.size))]
        x = np.arange(source.x_px, source.x_px + source.width_px, dtype=np.float32)
        y = np.arange(source.y_px, source.y_px + source.height_px, dtype=np.float32)
        along_x, along_y = np.minimum(x, self.size[0] - 1 - x), np.minimum(y, self.size[1] - 1 - y)
        return np.asarray(np.minimum(along_y[:, None], along_x) + 1, dtype=np.float32)

    @cached_property
    def _masked_distance(self) -> Float32 | None:
        if self.visible is None:
            return None
        framed = cv2.copyMakeBorder(self.visible, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
        return np.asarray(cv2.distanceTransform(framed, cv2.DIST_C, 3)[1:-1, 1:-1], dtype=np.float32)
