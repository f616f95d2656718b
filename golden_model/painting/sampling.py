"""Pixels of a frame at positions between its pixels, and their weights."""

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.formats import round_shift
from golden_model.painting.positions import POSITION

WEIGHT_BITS = 8


def weight_shift(width_px: int, height_px: int) -> int:
    """Bits that a distance to the border of the frame drops to fit a weight: none for frames of up to 511 lines."""
    return (min(width_px, height_px) >> WEIGHT_BITS + 1).bit_length()


def weigh(distance_px: NDArray[np.int64], width_px: int, height_px: int) -> NDArray[np.int64]:
    """Weights of pixels at a distance to the border of the frame.

    Parameters
    ----------
    distance_px : ndarray of int
        1 between the outermost pixels of the frame and the next ones; less than 1 outside.

    Returns
    -------
    ndarray of int64
        1 to 255, of the same shape; 0 outside.
    """
    shift = weight_shift(width_px, height_px)
    return np.where(distance_px > 0, np.maximum(distance_px >> shift, 1), 0)


def sample(frame: Pixels, positions: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Interpolate the colours of a frame bilinearly, and weigh them by their distance to its border.

    Parameters
    ----------
    frame : ndarray of uint8, shape (H, W, 3)
    positions : ndarray of int, shape (..., 2)
        x, y as `POSITION`.

    Returns
    -------
    colours : ndarray of int64, shape (..., 3)
        0 to 255, rounded once, halves up; without meaning outside the frame.
    weights : ndarray of int64, shape (...)
        See `weigh`; 0 where one of the four pixels around a position is outside the frame.
    """
    height_px, width_px = frame.shape[:2]
    whole, part = positions >> POSITION.fraction_bits, positions & POSITION.one - 1
    x, y = whole[..., 0], whole[..., 1]
    to_border = [x, width_px - 2 - x, y, height_px - 2 - y]
    weights = weigh(np.min(to_border, axis=0) + 1, width_px, height_px)
    x, y = np.where(weights, whole.transpose(-1, *range(x.ndim)), 0)
    right, down = part[..., 0, None], part[..., 1, None]
    upper, lower = (frame[row, x] * (POSITION.one - right) + frame[row, x + 1] * right for row in (y, y + 1))
    colours = round_shift(upper * (POSITION.one - down) + lower * down, 2 * POSITION.fraction_bits)
    return colours, weights
