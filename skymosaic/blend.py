"""Blending registered images into one (thesis, section III.6.4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from skymosaic.warp import Canvas, backward, footprint, shrunk, source_window, warp_tile

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
Float32 = NDArray[np.float32]

METHODS = ("average", "distance", "multiband")
SMALLEST_WEIGHT = 1e-3
"""Weight of a pixel on the image's own border: it counts only where no other image shows anything."""
BANDS = 5
TINY = float(np.finfo(np.float32).tiny)
PREVIEW_PX = 1_000_000
"""Area of the reduced canvas on which overlaps are compared."""
INTENSITY_SIGMA = 10.0
GAIN_SIGMA = 0.5
"""Expected spread of the overlap means (gray levels) and of the gains: overlaps decide, 1 is the anchor."""


@dataclass(frozen=True)
class _Layer:
    """An image with its transformation to the reference frame and its gain."""

    image: Pixels
    transform: Array
    gain: float

    @property
    def size(self) -> tuple[int, int]:
        return self.image.shape[1], self.image.shape[0]

    def part_of(self, canvas: Canvas) -> Canvas | None:
        """The part of the canvas that the image may touch."""
        return footprint(self.size, self.transform).intersection(canvas)

    def pixels(self, part: Canvas) -> Pixels:
        """The warped intensities times the gain; beyond the border, the border's."""
        warped = backward(self.image, self.transform, part, border=cv2.BORDER_REPLICATE)
        return warped if self.gain == 1 else np.asarray(cv2.convertScaleAbs(warped, alpha=self.gain), dtype=np.uint8)

    def border_distance(self, part: Canvas) -> Float32:
        """Distance from each pixel to the image's border, in the image's own pixels; 0 outside the image."""
        source = source_window(self.size, self.transform, part)
        x = np.arange(source.x_px, source.x_px + source.width_px, dtype=np.float32)
        y = np.arange(source.y_px, source.y_px + source.height_px, dtype=np.float32)
        along_x, along_y = np.minimum(x, self.size[0] - 1 - x), np.minimum(y, self.size[1] - 1 - y)
        # One more than the distance: what falls below 1 was interpolated with the outside.
        plus_one = np.minimum(along_y[:, None], along_x) + 1
        plus_one = warp_tile(plus_one, self.transform, source, part, cv2.BORDER_CONSTANT)
        inside = plus_one > 1 - SMALLEST_WEIGHT
        return np.where(inside, np.maximum(plus_one - 1, SMALLEST_WEIGHT), 0).astype(np.float32)


def blend(
    images: Sequence[Pixels],
    transforms: Sequence[Array],
    canvas: Canvas,
    *,
    method: str = "distance",
    gains: ArrayLike | None = None,
) -> Pixels:
    """Warp images onto a canvas and blend them where they overlap.

    Parameters
    ----------
    images : sequence of (H, W) or (H, W, 3) uint8 ndarray
        Gray or BGR; a mosaic of gray images is gray, any other BGR.
    transforms : sequence of (3, 3) float64 ndarray
        Image pixels to reference pixels; one that shrinks is served by an image reduced by area first.
    canvas : Canvas
        The rectangle of the reference frame to fill.
    method : {"average", "distance", "multiband"}
        The plain average; the average weighted by the distance to each image's own border (thesis, equation
        III-10), which fades every image out before it ends; or the distance's winner in each pixel, blended in
        frequency bands (Burt and Adelson 1983), which keeps detail where the registration is not perfect.
    gains : (N,) array_like, optional
        Factor on each image's intensities, from `exposure_gains`; default 1.

    Returns
    -------
    (height, width) or (height, width, 3) uint8 ndarray
        0 where no image shows anything.

    Raises
    ------
    ValueError
        For an unknown method.
    """
    if method not in METHODS:
        raise ValueError(f"blending method is {method!r}; valid: {', '.join(METHODS)}")
    layers = _layers(images, transforms, np.ones(len(images)) if gains is None else np.asarray(gains))
    mosaic = np.zeros((canvas.height_px, canvas.width_px, *layers[0].image.shape[2:]), dtype=np.uint8)
    for tile in canvas.tiles():
        if method == "multiband":
            mosaic[tile.within(canvas)] = _blend_bands(layers, tile)
        else:
            mosaic[tile.within(canvas)] = _blend_average(layers, tile, by_distance=method == "distance")
    return mosaic


def exposure_gains(images: Sequence[Pixels], transforms: Sequence[Array], canvas: Canvas) -> Array:
    """One gain per image that makes the mean intensities of each overlap agree (Brown and Lowe 2007, equation 29).

    Parameters
    ----------
    images, transforms, canvas
        As in `blend`; compared on a canvas of about a megapixel.

    Returns
    -------
    (N,) float64 ndarray
        Gains around 1; 1 for an image that overlaps no other.
    """
    scale = min(1.0, (PREVIEW_PX / (canvas.width_px * canvas.height_px)) ** 0.5)
    reduced = [np.diag([scale, scale, 1.0]) @ transform for transform in transforms]
    layers = _layers([_as_gray(image) for image in images], reduced, np.ones(len(images)))
    windows = [footprint(layer.size, layer.transform) for layer in layers]
    gray = [layer.pixels(window) for layer, window in zip(layers, windows, strict=True)]
    seen = [layer.border_distance(window) > 0 for layer, window in zip(layers, windows, strict=True)]
    system = np.diag([np.count_nonzero(mask) / GAIN_SIGMA**2 for mask in seen])
    target = system.diagonal().copy()
    for i, j in combinations(range(len(layers)), 2):
        overlap = windows[i].intersection(windows[j])
        if overlap is None:
            continue
        in_i, in_j = overlap.within(windows[i]), overlap.within(windows[j])
        both = seen[i][in_i] & seen[j][in_j]
        if both.any():
            means = np.array([gray[i][in_i][both].mean(), -gray[j][in_j][both].mean()])
            system[np.ix_((i, j), (i, j))] += np.count_nonzero(both) / INTENSITY_SIGMA**2 * np.outer(means, means)
    return np.asarray(np.linalg.solve(system, target))


def _layers(images: Sequence[Pixels], transforms: Sequence[Array], gains: Array) -> list[_Layer]:
    """The images ready for blending: all gray or all BGR, reduced by area where they will be shown small."""
    coloured = any(image.ndim == 3 for image in images)
    layers = []
    for image, transform, gain in zip(images, transforms, gains, strict=True):
        pixels, matrix = shrunk(image, transform)
        layers.append(_Layer(_as_bgr(pixels) if coloured else pixels, matrix, float(gain)))
    return layers


def _blend_average(layers: Sequence[_Layer], tile: Canvas, *, by_distance: bool) -> Pixels:
    """The weighted average of all images in one tile."""
    total = np.zeros((tile.height_px, tile.width_px, *layers[0].image.shape[2:]), dtype=np.float32)
    total_weight = np.zeros((tile.height_px, tile.width_px), dtype=np.float32)
    for layer in layers:
        part = layer.part_of(tile)
        if part is None:
            continue
        distance = layer.border_distance(part)
        weight = distance if by_distance else np.sign(distance)
        total[part.within(tile)] += layer.pixels(part) * _per_channel(weight, total)
        total_weight[part.within(tile)] += weight
    return _as_uint8(_divided(total, total_weight))


def _blend_bands(layers: Sequence[_Layer], tile: Canvas) -> Pixels:
    """Multi-band blending of one tile along the seams where another image's border becomes the farthest.

    In float32: the 16-bit pyramids of OpenCV's blender darken a mosaic by two gray levels on average.
    """
    around = _with_margin(tile)
    owner = _owners(layers, around)
    shape = (*owner.shape, *layers[0].image.shape[2:])
    total = [np.zeros((shape[0] >> k, shape[1] >> k, *shape[2:]), dtype=np.float32) for k in range(BANDS + 1)]
    total_weight = [np.zeros(band.shape[:2], dtype=np.float32) for band in total]
    for index in np.unique(owner[owner >= 0]):
        weight = (owner == index).astype(np.float32)
        for level, band in enumerate(_bands(layers[index].pixels(around).astype(np.float32))):
            total[level] += band * _per_channel(weight, band)
            total_weight[level] += weight
            weight = cv2.pyrDown(weight)
    blended = _divided(total[-1], total_weight[-1])
    for band, weight in zip(total[-2::-1], total_weight[-2::-1], strict=True):
        blended = cv2.pyrUp(blended) + _divided(band, weight)
    blended[owner < 0] = 0
    return _as_uint8(blended[tile.within(around)])


def _bands(image: Float32) -> Iterator[Float32]:
    """The Laplacian pyramid, finest first, and last what is left."""
    for _ in range(BANDS):
        coarser = cv2.pyrDown(image)
        yield image - cv2.pyrUp(coarser)
        image = coarser
    yield image


def _with_margin(tile: Canvas) -> Canvas:
    """The tile and all that its bands depend on, in whole pixels of the coarsest band.

    Reduction and expansion by `BANDS` levels reach less than two of its pixels each way, so the bands of
    neighbouring tiles agree: their sides are multiples of that pixel.
    """
    cell = 1 << BANDS
    width, height = (-(-side // cell) * cell for side in (tile.width_px, tile.height_px))
    return Canvas(tile.x_px - 4 * cell, tile.y_px - 4 * cell, width + 8 * cell, height + 8 * cell)


def _owners(layers: Sequence[_Layer], canvas: Canvas) -> NDArray[np.int16]:
    """For each pixel the image whose border is farthest away; -1 where there is none."""
    owner = np.full((canvas.height_px, canvas.width_px), -1, dtype=np.int16)
    farthest = np.zeros(owner.shape, dtype=np.float32)
    for index, layer in enumerate(layers):
        part = layer.part_of(canvas)
        if part is None:
            continue
        where = part.within(canvas)
        distance = layer.border_distance(part)
        farther = distance > farthest[where]
        farthest[where][farther] = distance[farther]
        owner[where][farther] = index
    return owner


def _divided(total: Float32, weight: Float32) -> Float32:
    """The mean of what was summed up; 0 where there is no weight."""
    return np.asarray(total / _per_channel(np.maximum(weight, TINY), total), dtype=np.float32)


def _per_channel(plane: Float32, pixels: Float32) -> Float32:
    return plane[..., None] if pixels.ndim == 3 else plane


def _as_bgr(image: Pixels) -> Pixels:
    return image if image.ndim == 3 else np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _as_gray(image: Pixels) -> Pixels:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def _as_uint8(values: Float32) -> Pixels:
    return np.asarray(np.rint(np.clip(values, 0, 255)), dtype=np.uint8)
