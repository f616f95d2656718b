"""Warps images into a common reference frame.

Every image has a homography from its pixels to those of the reference frame, the planar manifold of the thesis
(section II.2.4). A `Canvas` is a rectangle of that frame: the whole mosaic, a tile, or the part that one image covers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Float32, Intensities, Mask, Pixels, Points
from skymosaic.geometry.homography import apply, rescale, resize_matrix
from skymosaic.geometry.horizon import ahead, clip_polygon

CANVAS_LIMIT_PX = 250_000_000
"""Default limit on the area of a canvas."""
FAR_AWAY_PX = 1e12
"""No mosaic is so large; a corner that lies farther away is one at the horizon."""
TILE_PX = 1024
"""Side of the tiles that are warped at once. They fit the processor's cache and OpenCV's size limit of 32767 px."""
CELL_PX = 8
"""Side of the cells in whose middles is computed what hardly bends within one, see `Canvas.interpolate`."""
ROUNDING_PX = 1e-6
"""A corner this close to a pixel counts as on it, because products of transformations have rounding errors."""
SUPPORT_PX = 5
"""Margin around a source position that Lanczos interpolation may read, including rounding."""


class CanvasError(ValueError):
    """The images do not fit on a canvas: one extends behind the camera, or the canvas would be too large."""


@dataclass(frozen=True)
class Canvas:
    """A rectangle of whole pixels of the reference frame."""

    x_px: int
    y_px: int
    """First pixel in the reference frame."""
    width_px: int
    height_px: int

    @property
    def area_px(self) -> int:
        """Number of its pixels."""
        return self.width_px * self.height_px

    @property
    def translation(self) -> Array:
        """(3, 3): reference pixels to pixels of this rectangle."""
        return np.array([[1.0, 0, -self.x_px], [0, 1.0, -self.y_px], [0, 0, 1.0]])

    @property
    def corners(self) -> Array:
        """The centres (4, 2) of its corner pixels in the reference frame."""
        x, y = self.x_px + self.width_px - 1, self.y_px + self.height_px - 1
        return np.array([[self.x_px, self.y_px], [x, self.y_px], [x, y], [self.x_px, y]], dtype=np.float64)

    def intersection(self, other: Canvas) -> Canvas | None:
        """The rectangle that both cover; None without an overlap."""
        x, y = max(self.x_px, other.x_px), max(self.y_px, other.y_px)
        width = min(self.x_px + self.width_px, other.x_px + other.width_px) - x
        height = min(self.y_px + self.height_px, other.y_px + other.height_px) - y
        return Canvas(x, y, width, height) if width > 0 and height > 0 else None

    def grown(self, by_px: int) -> Canvas:
        """The rectangle with a margin on every side."""
        return Canvas(self.x_px - by_px, self.y_px - by_px, self.width_px + 2 * by_px, self.height_px + 2 * by_px)

    def bounding(self, mask: Mask) -> Canvas:
        """The smallest part that contains all pixels of a mask of this rectangle; the mask must not be empty."""
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        x, y = self.x_px + int(columns[0]), self.y_px + int(rows[0])
        return Canvas(x, y, int(columns[-1] - columns[0]) + 1, int(rows[-1] - rows[0]) + 1)

    def aligned(self, cell_px: int) -> Canvas:
        """The smallest rectangle of whole cells of the reference frame that contains this one."""
        x, y = self.x_px // cell_px, self.y_px // cell_px
        last_x, last_y = -(-(self.x_px + self.width_px) // cell_px), -(-(self.y_px + self.height_px) // cell_px)
        return Canvas(cell_px * x, cell_px * y, cell_px * (last_x - x), cell_px * (last_y - y))

    def within(self, other: Canvas) -> tuple[slice, slice]:
        """The rows and columns of this rectangle in an array of ``other``, which must contain it."""
        x, y = self.x_px - other.x_px, self.y_px - other.y_px
        return slice(y, y + self.height_px), slice(x, x + self.width_px)

    def interpolate(self, compute: Callable[[Points], Array], cell_px: int = CELL_PX) -> Float32:
        """Values of pixels, (height, width, C), that change slowly; ``compute`` has those of points (N, 2), (N, C).

        They are computed in the middles of cells of the reference frame, the same ones for all rectangles, and are
        bilinear in between.
        """
        around = self.grown(cell_px // 2).aligned(cell_px)
        sides = ((around.x_px, around.width_px), (around.y_px, around.height_px))
        x, y = (first + np.arange(0, side, cell_px) + (cell_px - 1) / 2 for first, side in sides)
        values = compute(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(len(y), len(x), -1)
        enlarged = cv2.resize(values.astype(np.float32), (around.width_px, around.height_px))
        return np.asarray(enlarged.reshape(*enlarged.shape[:2], -1)[self.within(around)], dtype=np.float32)

    def tiles(self, side_px: int = TILE_PX) -> Iterator[Canvas]:
        """Cut the rectangle into tiles of at most ``side_px`` x ``side_px`` pixels, row by row."""
        for y in range(0, self.height_px, side_px):
            for x in range(0, self.width_px, side_px):
                width, height = min(side_px, self.width_px - x), min(side_px, self.height_px - y)
                yield Canvas(self.x_px + x, self.y_px + y, width, height)


def enclosing_canvas(
    sizes: Sequence[tuple[int, int]],
    transforms: Sequence[Array],
    least_nearness: Sequence[float] | None = None,
    *,
    limit_px: float = CANVAS_LIMIT_PX,
) -> Canvas:
    """The smallest canvas that contains all images, each with arguments as of `outline`; by default the whole images.

    Raises
    ------
    CanvasError
        If a corner of an image maps to a point behind the camera, or the area exceeds the limit; nothing is allocated
        before.
    """
    least_nearness = least_nearness or [0.0] * len(sizes)
    whole = enclosing([footprint(*image) for image in zip(sizes, transforms, least_nearness, strict=True)])
    if whole.area_px > limit_px:
        raise CanvasError(
            f"the canvas would be {whole.width_px}x{whole.height_px} px, {whole.area_px / 1e6:.0f} megapixels; "
            f"the limit is {limit_px / 1e6:.0f}"
        )
    return whole


def enclosing(parts: Sequence[Canvas]) -> Canvas:
    """The smallest rectangle that contains all of some."""
    x, y = min(part.x_px for part in parts), min(part.y_px for part in parts)
    width = max(part.x_px + part.width_px for part in parts) - x
    return Canvas(x, y, width, max(part.y_px + part.height_px for part in parts) - y)


def footprint(size: tuple[int, int], transform: Array, least_nearness: float = 0.0) -> Canvas:
    """The bounding rectangle of the reference pixels whose centres an image may cover; arguments as of `outline`.

    Raises
    ------
    CanvasError
        If a corner of the image maps to a point behind the camera, or about as far away.
    """
    mapped = apply(transform, outline(size, transform, least_nearness))
    if not np.abs(mapped).max() < FAR_AWAY_PX:
        raise CanvasError(f"an image of {size[0]}x{size[1]} px would reach to the horizon")
    first = np.ceil(mapped.min(axis=0) - ROUNDING_PX)
    last = np.floor(mapped.max(axis=0) + ROUNDING_PX)
    return Canvas(int(first[0]), int(first[1]), int(last[0] - first[0]) + 1, int(last[1] - first[1]) + 1)


def outline(size: tuple[int, int], transform: Array, least_nearness: float = 0.0) -> Array:
    """Corners (N, 2), image pixels, of the part of an image that is near enough; four where that is all of it.

    The transformation is from image pixels to reference pixels. A ``least_nearness``, see `nearness`, of 0 takes the
    whole image.

    Raises
    ------
    CanvasError
        If all of it should be taken, and a corner maps to a point behind the camera.
    """
    corners = Canvas(0, 0, *size).corners
    near = nearness(size, transform, corners)
    if least_nearness <= 0:
        if near.min() <= 0:
            raise CanvasError(f"a corner of an image of {size[0]}x{size[1]} px would lie behind the camera")
        return corners
    return clip_polygon(corners, near - least_nearness)


def nearness(size: tuple[int, int], transform: Array, points: Array) -> Array:
    """How near to the camera the ground at image points (N, 2) is: 1 at the nearest corner, 0 at the horizon, (N,).

    It is the third homogeneous coordinate. The ground that a pixel covers grows with its third power.
    """
    return np.asarray((points @ transform[2, :2] + transform[2, 2]) / nearest_corner(size, transform))


def nearest_corner(size: tuple[int, int], transform: Array) -> float:
    """The third homogeneous coordinate of the corner that is nearest to the camera; its sign is arbitrary."""
    corners = Canvas(0, 0, *size).corners
    nearest = corners[np.argmax(ahead(transform, corners))]
    return float(transform[2] @ [*nearest, 1])


def magnification(size: tuple[int, int], transform: Array) -> float:
    """Pixels of the reference frame per pixel of an image of ``size`` (width, height), at its centre."""
    x, y = (np.array(size) - 1) / 2
    along_x, along_y = apply(transform, [(x + 1, y), (x, y + 1)]) - apply(transform, (x, y))
    return math.sqrt(abs(along_x[0] * along_y[1] - along_x[1] * along_y[0]))


def shrink(image: Intensities, transform: Array) -> tuple[Intensities, Array]:
    """Reduce an image by area if its transformation shrinks it to half or less; returns image and transformation.

    Bilinear interpolation reads only four pixels, so an image that becomes much smaller has to be averaged first.
    """
    height, width = image.shape[:2]
    # Just below a whole number, rounding errors must not reduce by less.
    factor = min(int(1 / max(magnification((width, height), transform), 1e-6) + 1e-6), width, height)
    if factor < 2:
        return image, transform
    small = (width // factor, height // factor)
    enlarge = resize_matrix(width / small[0], height / small[1])
    return np.asarray(cv2.resize(image, small, interpolation=cv2.INTER_AREA), dtype=image.dtype), transform @ enlarge


def source_window(size: tuple[int, int], transform: Array, tile: Canvas) -> Canvas:
    """The rectangle of image pixels that a tile needs; outside the image, the nearest part of its border."""
    inverse = np.asarray(np.linalg.inv(rescale(transform)), dtype=np.float64)
    depth = tile.corners @ inverse[2, :2] + inverse[2, 2]
    # Corners of a tile that extends beyond the horizon do not bound what it shows.
    if depth.min() <= 0:
        return Canvas(0, 0, *size)
    mapped = apply(inverse, tile.corners)
    last_pixel = np.array(size) - 1
    x, y = np.clip(np.floor(mapped.min(axis=0)) - SUPPORT_PX, 0, last_pixel).astype(int).tolist()
    last_x, last_y = np.clip(np.ceil(mapped.max(axis=0)) + SUPPORT_PX, 0, last_pixel).astype(int).tolist()
    return Canvas(x, y, last_x - x + 1, last_y - y + 1)


def warp_backward(
    image: Intensities,
    transform: Array,
    canvas: Canvas,
    *,
    border: int = cv2.BORDER_CONSTANT,
    interpolation: int = cv2.INTER_LINEAR,
) -> Intensities:
    """Warp an image or a mask backward into a canvas of any size, x = H^-1 x' (thesis, equation II-17).

    OpenCV's border mode is by default 0 outside the image; or ``cv2.BORDER_REPLICATE``. Its interpolation is bilinear
    as in the thesis; or ``cv2.INTER_LANCZOS4``, which keeps fine detail.
    """
    whole_size = (image.shape[1], image.shape[0])
    warped = np.empty((canvas.height_px, canvas.width_px, *image.shape[2:]), dtype=image.dtype)
    for tile in canvas.tiles():
        source = source_window(whole_size, transform, tile)
        part = image[source.within(Canvas(0, 0, *whole_size))]
        warped[tile.within(canvas)] = warp_tile(
            part, transform, source, tile, border=border, interpolation=interpolation
        )
    return warped


def warp_tile(
    part: NDArray[np.generic],
    transform: Array,
    source: Canvas,
    tile: Canvas,
    *,
    border: int,
    interpolation: int = cv2.INTER_LINEAR,
) -> Pixels:
    """Warp ``part``, the pixels of an image inside ``source``, into one tile."""
    matrix = tile.translation @ transform @ np.linalg.inv(source.translation)
    size = (tile.width_px, tile.height_px)
    return np.asarray(cv2.warpPerspective(part, matrix, size, flags=interpolation, borderMode=border))
