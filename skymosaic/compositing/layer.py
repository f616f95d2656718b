"""A photograph as a layer of a mosaic: its warped pixels, and how strongly it claims each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Intensities, Mask, Pixels, Points
from skymosaic.compositing.mesh import Mesh
from skymosaic.compositing.tone import NEUTRAL, Tone
from skymosaic.compositing.warp import Canvas, footprint, nearest_corner, source_window, warp_backward, warp_tile
from skymosaic.geometry.homography import apply, resize_matrix
from skymosaic.imagery.depth import measure_clipped
from skymosaic.imagery.parcel import Parcel

MIN_WEIGHT = 1e-3
"""Weight of a pixel on the image's own border, so that it counts where no other image covers the pixel."""
CLIPPED_CLAIM, MAX_CLIPPED = 0.01, 0.25
"""What is left of the claim where the second share of the pixels around is clipped: the ground there was not
photographed. Less takes less, so that of a bracket the right exposure shows sparkling leaves, but no coarse photograph
a bright roof. Around is in 3 by 3 cells of `skymosaic.imagery.depth.measure_clipped`.
"""
BEYOND = cv2.BORDER_REPLICATE
FINE_BLOCK_PX, FINE_REACH_PX = 32, 8
"""Fine detail is computed in blocks of this side, and this far beyond what is shown, as far as the finest two bands
reach. `Layer.pixels_around` takes parts of whole blocks."""


@dataclass(frozen=True, eq=False)
class SeamMask:
    """Pixels that seams assign to a photograph, on a reduced canvas."""

    mask: Parcel
    """(h, w): 255 where the photograph shows, else 0; compressed on its way to the workers."""
    canvas: Canvas
    """The part of the reduced reference frame that the mask covers."""
    scale: float
    """Pixels of the reduced frame per pixel of the reference frame."""

    def shown_part(self, part: Canvas) -> Canvas | None:
        """The rectangle of ``part`` in which `share` is not 0, or within a mask pixel of it; None if there is none."""
        first, last = apply(self._to_mask, part.corners[[0, 2]])
        (x, y), ends = np.floor(first).astype(int).tolist(), np.ceil(last).astype(int) + 1
        # A mask continues beyond its rectangle.
        near = np.take(np.take(self.mask.pixels, range(y, ends[1]), 0, mode="clip"), range(x, ends[0]), 1, mode="clip")
        if not near.any():
            return None
        box = Canvas(x, y, *near.shape[::-1]).bounding(near).grown(1)
        to_reference = np.asarray(np.linalg.inv(box.translation @ self._to_mask))
        return footprint((box.width_px, box.height_px), to_reference).intersection(part)

    def share(self, part: Canvas) -> Pixels:
        """Interpolate the mask to ``part`` of the reference frame, 0..255, which smooths the seams."""
        matrix = self._to_mask @ np.linalg.inv(part.translation)
        size = (part.width_px, part.height_px)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        enlarged = cv2.warpAffine(self.mask.pixels, matrix[:2], size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(enlarged, dtype=np.uint8)

    @property
    def _to_mask(self) -> Array:
        return self.canvas.translation @ resize_matrix(self.scale)


@dataclass(frozen=True, eq=False)
class Layer:
    """A photograph with its transformation to the reference frame."""

    image: Intensities
    transform: Array
    """(3, 3): image pixels to reference pixels."""
    tone: Tone = NEUTRAL
    visible: Pixels | None = None
    """(H, W): 255 where the image shows the ground, else 0; None: everywhere."""
    favour: float = 1.0
    """Factor on the claim, below 1 for a photograph that should show only where others do not."""
    seam: SeamMask | None = None
    """The pixels that seams assign to it; None: each pixel belongs to the photograph with the largest `claim`."""
    least_nearness: float = 0.0
    """What is farther from the camera is not shown, see `skymosaic.compositing.warp.nearness`; 0 shows all."""
    mesh: Mesh | None = None
    """Warps the image, its mask and its border before ``transform``; None where it keeps its shape."""
    clipped: Pixels | None = None
    """The clipped share of the photograph that a thumbnail shows, which averages it; None: that of the image."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        return self.image.shape[1], self.image.shape[0]

    @property
    def footprint(self) -> Canvas:
        """The rectangle of the reference frame that the image may cover."""
        return footprint(self.size, self.transform, self.least_nearness)

    def shown_part(self, canvas: Canvas) -> Canvas | None:
        """The part of the canvas that the image may cover; None if there is none, or the seams leave nothing of it."""
        part = self.footprint.intersection(canvas)
        return part if part is None or self.seam is None else self.seam.shown_part(part)

    def pixels(self, part: Canvas, interpolation: int = cv2.INTER_LANCZOS4) -> Intensities:
        """The warped and toned intensities; the image's border pixels are repeated beyond it."""
        return self._toned(part, self._warp(part, interpolation, self._bent(part)))

    def pixels_around(self, part: Canvas, shown: Mask) -> Intensities:
        """As `pixels`, but with fine detail only near ``shown`` pixels; a blend needs low frequencies elsewhere.

        Lanczos's kernel keeps the energy of fine detail, while bicubic interpolation loses a tenth of it. But it takes
        ten times as long as bilinear interpolation.
        """
        near = cv2.dilate(shown.astype(np.uint8), np.ones((2 * FINE_REACH_PX + 1,) * 2, np.uint8))
        bent = self._bent(part)
        warped = self._warp(part, cv2.INTER_LINEAR, bent)
        # Neighbouring blocks are warped together, because each call has a fixed cost.
        for y_px in range(part.y_px, part.y_px + part.height_px, FINE_BLOCK_PX):
            row = replace(part, y_px=y_px, height_px=FINE_BLOCK_PX)
            if (fine := near[row.within(part)]).any():
                run = row.bounding(fine).aligned(FINE_BLOCK_PX)
                where = run.within(part)
                warped[where] = self._warp(run, cv2.INTER_LANCZOS4, bent and (bent[0], bent[1][where]))
        return self._toned(part, warped)

    def _bent(self, part: Canvas) -> tuple[Canvas, Float32] | None:
        """The window of the image that a part needs, and the part's pixels in it, (h, w, 2); None without a mesh."""
        if self.mesh is None:
            return None
        source = self.mesh.window(self.size, self.transform, part)
        return source, self.mesh.places(self.size, self.transform, part, (source.x_px, source.y_px))

    def _warp(self, part: Canvas, interpolation: int, bent: tuple[Canvas, Float32] | None) -> Intensities:
        if bent is None:
            return warp_backward(self.image, self.transform, part, border=BEYOND, interpolation=interpolation)
        source, places = bent
        # OpenCV takes no images wider than 32767 px.
        window = self.image[source.within(Canvas(0, 0, *self.size))]
        return np.asarray(cv2.remap(window, places, None, interpolation, borderMode=BEYOND), dtype=self.image.dtype)

    def _toned(self, part: Canvas, warped: Intensities) -> Intensities:
        if not self.tone.varies:
            return self.tone.apply(warped)
        return self.tone.apply(warped, self.tone.factors(self.size, part, np.asarray(np.linalg.inv(self.transform))))

    def border_distance(self, part: Canvas) -> Float32:
        """Distance of each pixel from the border of the image's visible part, in image pixels; 0 outside."""
        # Warping interpolates. With 1 added to the distance, values below 1 are mixtures with the outside.
        plus_one = self._warp_window(self._plus_one, part)
        inside = (plus_one > 1 - MIN_WEIGHT) & self._is_near(part)
        return np.where(inside, np.maximum(plus_one - 1, MIN_WEIGHT), 0).astype(np.float32)

    def claim(self, part: Canvas) -> Float32:
        """Claim to each pixel, by the seams or else by detail, clipping and the distance from the border; 0 outside.

        The layer with the largest claim shows the pixel. Where an image shows the ground with twice the resolution of
        another one, it needs half the distance.
        """
        if self.seam is None:
            claim = self.border_distance(part) * self._detail(part) * np.float32(self.favour)
            return claim * self._warp_window(self._unclipped_part, part)
        return self.seam.share(part) * self.covers(part)

    def covers(self, part: Canvas) -> Float32:
        """1 where the image shows the ground, else 0."""
        return np.asarray((self._warp_window(self._visible_part, part) == 255) & self._is_near(part), dtype=np.float32)

    def _warp_window(self, cut: Callable[[Canvas], Pixels | Float32], part: Canvas) -> Pixels | Float32:
        """Warp what ``cut`` has in the window of the image that a part needs; 0 outside the image."""
        if (bent := self._bent(part)) is None:
            source = source_window(self.size, self.transform, part)
            return warp_tile(cut(source), self.transform, source, part, border=cv2.BORDER_CONSTANT)
        source, places = bent
        return np.asarray(cv2.remap(cut(source), places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT))

    def _visible_part(self, source: Canvas) -> Pixels:
        if self.visible is None:
            return np.full((source.height_px, source.width_px), 255, np.uint8)
        return self.visible[source.within(Canvas(0, 0, *self.size))]

    def _unclipped_part(self, source: Canvas) -> Float32:
        """What clipping leaves of the claim, in a window of the image."""
        rows, columns = self._unclipped_cells.shape
        to_cells = resize_matrix(columns / self.size[0], rows / self.size[1]) @ np.linalg.inv(source.translation)
        size, flags = (source.width_px, source.height_px), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cells = cv2.warpAffine(self._unclipped_cells, to_cells[:2], size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(cells, dtype=np.float32)

    @cached_property
    def _unclipped_cells(self) -> Float32:
        share = measure_clipped(self.image) if self.clipped is None else self.clipped
        left = 1 - cv2.blur(share.astype(np.float32), (3, 3)) / np.float32(255 * MAX_CLIPPED)
        return np.asarray(np.maximum(left, CLIPPED_CLAIM), dtype=np.float32)

    def _is_near(self, part: Canvas) -> Mask:
        """Where the ground is near enough to be shown."""
        if self.least_nearness <= 0:
            return np.ones((part.height_px, part.width_px), dtype=np.bool_)
        remoteness = self._remoteness(part)
        return np.asarray((remoteness > 0) & (remoteness <= 1 / self.least_nearness))

    def _detail(self, part: Canvas) -> Float32:
        """Image pixels per reference pixel in the direction that has fewest; any number where the image cannot reach.

        Ground seen at a slant has many along the horizon and few towards it, so an area would praise it.
        """
        nearest, inverse = nearest_corner(self.size, self.transform), np.linalg.inv(self.transform)

        def compute(points: Points) -> Array:
            placed = points @ inverse[:, :2].T + inverse[:, 2]
            third = np.maximum(placed[:, 2] * nearest, MIN_WEIGHT) / nearest
            area = 1 / np.abs(float(np.linalg.det(self.transform)) * third**3)
            slope = placed[:, :2, None] * inverse[2, :2] / third[:, None, None]
            along = (inverse[:2, :2] - slope) / third[:, None, None]
            # The larger singular value of the derivative, by those of its product with its transpose.
            (xx, xy), (_, yy) = np.moveaxis(along.swapaxes(1, 2) @ along, 0, -1)
            return np.asarray(area / np.sqrt((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)))

        return part.interpolate(compute)[..., 0]

    def _remoteness(self, part: Canvas) -> Array:
        """The reciprocal of `skymosaic.compositing.warp.nearness` at pixels of the reference frame."""
        # The inverse maps a pixel to the reciprocal of the third coordinate that the transformation gave it.
        inverse = np.linalg.inv(self.transform) * nearest_corner(self.size, self.transform)
        x, y = np.arange(part.width_px) + part.x_px, np.arange(part.height_px) + part.y_px
        return np.asarray(inverse[2, 0] * x + (inverse[2, 1] * y + inverse[2, 2])[:, None])

    def _plus_one(self, source: Canvas) -> Float32:
        """The distance plus 1, in a window of the image."""
        if self._masked_distance is not None:
            return self._masked_distance[source.within(Canvas(0, 0, *self.size))]
        x = np.arange(source.x_px, source.x_px + source.width_px, dtype=np.float32)
        y = np.arange(source.y_px, source.y_px + source.height_px, dtype=np.float32)
        # The chessboard distance, like DIST_C below for images with a mask.
        along_x, along_y = np.minimum(x, self.size[0] - 1 - x), np.minimum(y, self.size[1] - 1 - y)
        return np.asarray(np.minimum(along_y[:, None], along_x) + 1, dtype=np.float32)

    @cached_property
    def _masked_distance(self) -> Float32 | None:
        if self.visible is None:
            return None
        # Without a frame of zeros, the image's own border would not count as one.
        framed = cv2.copyMakeBorder(self.visible, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
        return np.asarray(cv2.distanceTransform(framed, cv2.DIST_C, 3)[1:-1, 1:-1], dtype=np.float32)
