"""Blending registered images into one (thesis, section III.6.4)."""

from collections.abc import Iterator, Sequence
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Float32, Intensities
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.tone import round_to
from skymosaic.compositing.warp import Canvas

Blending = Literal["average", "distance", "multiband"]
Owners = NDArray[np.int16]
BANDS = 5
DETAIL_PX = 32
"""Fine detail farther from a tile than this reaches it only in coarse bands, which contain none of it."""
TINY = float(np.finfo(np.float32).tiny)


def blend_layers(layers: Sequence[Layer], canvas: Canvas, *, method: Blending) -> tuple[Intensities, Owners]:
    """Warp layers onto a canvas and blend them where they overlap.

    The layers are all gray or all BGR, and all of uint8 or all of uint16; they may have masks and seams. Returns also
    which layer each pixel shows, or shows most, its index, (H, W); -1, and pixels of 0, where there is none.

    Parameters
    ----------
    method : {"average", "distance", "multiband"}
        The plain average; the average weighted by the distance to each image's own border (thesis, equation III-10),
        which fades images out towards their borders; or the image with the largest distance in each pixel, blended in
        frequency bands (Burt and Adelson 1983), which keeps detail where the registration is not perfect.
    """
    mosaic = np.zeros((canvas.height_px, canvas.width_px, *layers[0].image.shape[2:]), dtype=layers[0].image.dtype)
    owner = np.full(mosaic.shape[:2], -1, dtype=np.int16)
    for tile in canvas.tiles():
        where = tile.within(canvas)
        if method == "multiband":
            mosaic[where], owner[where] = _blend_bands(layers, tile)
        else:
            mosaic[where], owner[where] = _blend_average(layers, tile, by_distance=method == "distance")
    return mosaic, owner


def _blend_average(layers: Sequence[Layer], tile: Canvas, *, by_distance: bool) -> tuple[Intensities, Owners]:
    """Blend one tile by the weighted average of all images."""
    total = np.zeros((tile.height_px, tile.width_px, *layers[0].image.shape[2:]), dtype=np.float32)
    total_weight = np.zeros((tile.height_px, tile.width_px), dtype=np.float32)
    owner, largest = np.full(total_weight.shape, -1, dtype=np.int16), np.zeros_like(total_weight)
    for index, layer in enumerate(layers):
        part = layer.footprint.intersection(tile)
        if part is None:
            continue
        distance = layer.border_distance(part)
        # Inside the image every distance is positive, so its sign is the weight of a plain average.
        weight = np.float32(layer.favour) * (distance if by_distance else np.sign(distance))
        where = part.within(tile)
        total[where] += layer.pixels(part) * _per_channel(weight, total)
        total_weight[where] += weight
        _claim(owner[where], largest[where], index, weight)
    return round_to(_divide(total, total_weight), layers[0].image.dtype), owner


def _blend_bands(layers: Sequence[Layer], tile: Canvas) -> tuple[Intensities, Owners]:
    """Blend one tile in frequency bands; each pixel belongs to the layer with the largest claim.

    The pyramids are in float32. OpenCV's blender, with pyramids of 16 bits, darkens a mosaic by two gray levels on
    average.
    """
    around = _with_margin(tile)
    owner, _ = find_owners(layers, around)
    if owner.min() == owner.max() >= 0:
        # The bands of a single photograph add up to the photograph itself.
        return layers[int(owner.max())].pixels(tile), owner[tile.within(around)]
    shape = (*owner.shape, *layers[0].image.shape[2:])
    in_detail = np.zeros(owner.shape, dtype=np.bool_)
    in_detail[tile.grown(DETAIL_PX).within(around)] = True
    finest = np.zeros(shape, dtype=np.float32)
    coarser = [np.zeros((shape[0] >> k, shape[1] >> k, *shape[2:]), dtype=np.float32) for k in range(1, BANDS + 1)]
    weights = [np.zeros(band.shape[:2], dtype=np.float32) for band in coarser]
    # Only layers that own a pixel are warped.
    for index in np.flatnonzero(np.bincount(owner[owner >= 0])).tolist():
        shown = owner == index
        part = _with_margin(around.bounding(shown)).intersection(around) or around
        where = part.within(around)
        weight = shown[where].astype(np.float32)
        bands = _split_bands(layers[index].pixels_around(part, (shown & in_detail)[where]).astype(np.float32))
        # A pixel has one owner, so the finest band needs no weights.
        cv2.copyTo(next(bands), shown[where].astype(np.uint8), finest[where])
        for total, total_weight, band in zip(coarser, weights, bands, strict=True):
            weight, where = cv2.pyrDown(weight), _halved(where)
            cv2.accumulateProduct(band, _per_channel(weight, band), total[where])
            total_weight[where] += weight
    blended = _join_bands(finest, coarser, weights)
    blended[owner < 0] = 0
    inside = tile.within(around)
    return round_to(blended[inside], layers[0].image.dtype), owner[inside]


def _split_bands(image: Float32) -> Iterator[Float32]:
    """Split an image into its Laplacian pyramid: `BANDS` bands, finest first, then the remaining low frequencies."""
    for _ in range(BANDS):
        coarser = cv2.pyrDown(image)
        yield image - cv2.pyrUp(coarser)
        image = coarser
    yield image


def _join_bands(finest: Float32, coarser: Sequence[Float32], weights: Sequence[Float32]) -> Float32:
    """Join a pyramid, whose coarser bands are sums with weights, into an image."""
    joined = _divide(coarser[-1], weights[-1])
    for band, weight in zip(coarser[-2::-1], weights[-2::-1], strict=True):
        joined = cv2.pyrUp(joined) + _divide(band, weight)
    return np.asarray(cv2.pyrUp(joined) + finest)


def _with_margin(part: Canvas) -> Canvas:
    """Add a margin with all pixels that a part's bands depend on, aligned to pixels of the coarsest band.

    White instead of black three coarsest pixels away changes a pixel by less than a ten-thousandth of a gray level.
    Since the margin is aligned to the reference frame, the bands of neighbouring tiles agree.
    """
    cell_px = 1 << BANDS
    return part.aligned(cell_px).grown(3 * cell_px)


def _halved(where: tuple[slice, slice]) -> tuple[slice, slice]:
    rows, columns = (slice(axis.start >> 1, axis.stop >> 1) for axis in where)
    return rows, columns


def find_owners(layers: Sequence[Layer], canvas: Canvas) -> tuple[Owners, Float32]:
    """Index of the layer with the largest claim to each pixel, -1 without a claim; and that claim."""
    owner = np.full((canvas.height_px, canvas.width_px), -1, dtype=np.int16)
    strongest = np.zeros(owner.shape, dtype=np.float32)
    shown = {index: part for index, layer in enumerate(layers) if (part := layer.shown_part(canvas)) is not None}
    for index, part in shown.items():
        where = part.within(canvas)
        _claim(owner[where], strongest[where], index, layers[index].claim(part))
    # Pixels between two masks and beyond the last one have no owner, so any image that covers them may show them.
    for index in shown:
        whole = layers[index].footprint.intersection(canvas)
        if layers[index].seam is not None and whole and (left := owner[whole.within(canvas)] < 0).any():
            where = (part := whole.bounding(left)).within(canvas)
            _claim(owner[where], strongest[where], index, layers[index].covers(part))
    return owner, strongest


def _claim(owner: Owners, strongest: Float32, index: int, claim: Float32) -> None:
    """Give a layer the pixels to which it has the strongest claim up to now."""
    stronger = claim > strongest
    cv2.copyTo(claim, stronger.view(np.uint8), strongest)
    owner[stronger] = index


def _divide(total: Float32, weight: Float32) -> Float32:
    """Divide a weighted sum by its weights; 0 where the weight is 0."""
    return np.asarray(total / _per_channel(np.maximum(weight, TINY), total), dtype=np.float32)


def _per_channel(plane: Float32, pixels: Float32) -> Float32:
    """Repeat a plane for each channel of ``pixels``, because broadcasting multiplies three times slower."""
    return plane if pixels.ndim == 2 else np.asarray(cv2.merge([plane] * pixels.shape[2]), dtype=np.float32)
