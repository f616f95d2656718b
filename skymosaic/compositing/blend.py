"""Blending registered images into one (thesis, section III.6.4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from golden_model.arrays import Array, Float32, Mask, Pixels
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.warp import Canvas, footprint, shrunk

METHODS = ("average", "distance", "multiband")
BANDS = 5
TINY = float(np.finfo(np.float32).tiny)
PREVIEW_PX = 1_000_000
"""Area of the reduced canvas on which overlaps are compared."""
INTENSITY_SIGMA = 10.0
GAIN_SIGMA = 0.5
"""Expected spread of the overlap means (gray levels) and of the gains: overlaps decide, 1 is the anchor."""


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
    gains : (N,) or (N, 3) array_like, optional
        Factor on each image's intensities, or on each of its channels, from `exposure_gains`; default 1.

    Returns
    -------
    (height, width) or (height, width, 3) uint8 ndarray
        0 where no image shows anything.

    Raises
    ------
    ValueError
        For an unknown method.
    """
    factors = np.ones(len(images)) if gains is None else np.asarray(gains, dtype=np.float64)
    return blend_layers(layers_of(images, transforms, factors), canvas, method=method)


def blend_layers(layers: Sequence[Layer], canvas: Canvas, *, method: str = "distance") -> Pixels:
    """`blend` for layers, which may have masks and seams; all are gray or all BGR."""
    if method not in METHODS:
        raise ValueError(f"blending method is {method!r}; valid: {', '.join(METHODS)}")
    mosaic = np.zeros((canvas.height_px, canvas.width_px, *layers[0].image.shape[2:]), dtype=np.uint8)
    for tile in canvas.tiles():
        if method == "multiband":
            mosaic[tile.within(canvas)] = _blend_bands(layers, tile)
        else:
            mosaic[tile.within(canvas)] = _blend_average(layers, tile, by_distance=method == "distance")
    return mosaic


def layers_of(
    images: Sequence[Pixels], transforms: Sequence[Array], gains: Array, *, coloured: bool | None = None
) -> list[Layer]:
    """The images ready for blending: all gray or all BGR, reduced by area where they will be shown small.

    Parameters
    ----------
    images, transforms
        As in `blend`.
    gains : (N,) or (N, 3) float64 ndarray
    coloured : bool or None
        Whether the layers are BGR; None: if any image is.
    """
    if coloured is None:
        coloured = any(image.ndim == 3 for image in images)
    layers = []
    for image, transform, gain in zip(images, transforms, gains.reshape(len(images), -1), strict=True):
        pixels, matrix = shrunk(image, transform)
        layers.append(Layer(_as_bgr(pixels) if coloured else pixels, matrix, tuple(gain.tolist())))
    return layers


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
    layers = layers_of([_as_gray(image) for image in images], reduced, np.ones(len(images)))
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


def _blend_average(layers: Sequence[Layer], tile: Canvas, *, by_distance: bool) -> Pixels:
    """The weighted average of all images in one tile."""
    total = np.zeros((tile.height_px, tile.width_px, *layers[0].image.shape[2:]), dtype=np.float32)
    total_weight = np.zeros((tile.height_px, tile.width_px), dtype=np.float32)
    for layer in layers:
        part = layer.part_of(tile)
        if part is None:
            continue
        distance = layer.border_distance(part)
        weight = np.float32(layer.favour) * (distance if by_distance else np.sign(distance))
        total[part.within(tile)] += layer.pixels(part) * _per_channel(weight, total)
        total_weight[part.within(tile)] += weight
    return _as_uint8(_divided(total, total_weight))


def _blend_bands(layers: Sequence[Layer], tile: Canvas) -> Pixels:
    """Multi-band blending of one tile along the seams where another image's border becomes the farthest.

    In float32: the 16-bit pyramids of OpenCV's blender darken a mosaic by two gray levels on average.
    """
    around = _with_margin(tile)
    owner = _owners(layers, around)
    shape = (*owner.shape, *layers[0].image.shape[2:])
    total = [np.zeros((shape[0] >> k, shape[1] >> k, *shape[2:]), dtype=np.float32) for k in range(BANDS + 1)]
    total_weight = [np.zeros(band.shape[:2], dtype=np.float32) for band in total]
    for index in np.flatnonzero(np.bincount(owner[owner >= 0])).tolist():
        shown = owner == index
        part = _with_margin(_bounds(shown, around)).intersection(around) or around
        weight = shown[part.within(around)].astype(np.float32)
        where = part.within(around)
        for level, band in enumerate(_bands(layers[index].pixels(part).astype(np.float32))):
            total[level][where] += band * _per_channel(weight, band)
            total_weight[level][where] += weight
            weight = cv2.pyrDown(weight)
            where = _halved(where)
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


def _with_margin(part: Canvas) -> Canvas:
    """The part and all that its bands depend on, in whole pixels of the coarsest band of the reference frame.

    Reduction and expansion by `BANDS` levels reach less than two of its pixels each way, so the bands of
    neighbouring tiles agree.
    """
    cell = 1 << BANDS
    x, y = part.x_px // cell - 4, part.y_px // cell - 4
    last_x, last_y = -(-(part.x_px + part.width_px) // cell) + 4, -(-(part.y_px + part.height_px) // cell) + 4
    return Canvas(cell * x, cell * y, cell * (last_x - x), cell * (last_y - y))


def _halved(where: tuple[slice, slice]) -> tuple[slice, slice]:
    rows, columns = (slice(axis.start >> 1, axis.stop >> 1) for axis in where)
    return rows, columns


def _bounds(shown: Mask, canvas: Canvas) -> Canvas:
    """The smallest rectangle that holds all that is shown of a canvas."""
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    x, y = canvas.x_px + int(columns[0]), canvas.y_px + int(rows[0])
    return Canvas(x, y, int(columns[-1] - columns[0]) + 1, int(rows[-1] - rows[0]) + 1)


def _owners(layers: Sequence[Layer], canvas: Canvas) -> NDArray[np.int16]:
    """For each pixel the layer that claims it most; -1 where there is none."""
    owner = np.full((canvas.height_px, canvas.width_px), -1, dtype=np.int16)
    strongest = np.zeros(owner.shape, dtype=np.float32)
    for index, layer in enumerate(layers):
        part = layer.shown_part_of(canvas)
        if part is None:
            continue
        where = part.within(canvas)
        claim = layer.claim(part)
        stronger = claim > strongest[where]
        strongest[where][stronger] = claim[stronger]
        owner[where][stronger] = index
    return owner


def _divided(total: Float32, weight: Float32) -> Float32:
    """The mean of what was summed up; 0 where there is no weight."""
    return np.asarray(total / _per_channel(np.maximum(weight, TINY), total), dtype=np.float32)


def _per_channel(plane: Float32, pixels: Float32) -> Float32:
    """The plane once a channel of ``pixels``; merged, it multiplies three times as fast as broadcast."""
    return plane if pixels.ndim == 2 else np.asarray(cv2.merge([plane] * pixels.shape[2]), dtype=np.float32)


def _as_bgr(image: Pixels) -> Pixels:
    return image if image.ndim == 3 else np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _as_gray(image: Pixels) -> Pixels:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def _as_uint8(values: Float32) -> Pixels:
    return np.asarray(np.rint(np.clip(values, 0, 255)), dtype=np.uint8)
