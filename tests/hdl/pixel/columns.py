"""Columns of pixels as the line memories give them, and gradients of a frame."""

import numpy as np
from numpy.typing import NDArray

from golden_model.pixel import smooth, sobel


def columns(plane: NDArray[np.generic], lines: int) -> NDArray[np.generic]:
    """For each pixel, itself and the ``lines - 1`` above it, in this order; pixels above the frame are arbitrary."""
    above = np.pad(plane, ((lines - 1, 0), (0, 0)), mode="reflect")
    return np.stack([above[lines - 1 - n : len(above) - n] for n in range(lines)], axis=-1)


def gradients(frame: NDArray[np.uint8], smoothed: bool) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """The golden model's gradients of a frame, smoothed before or not."""
    return sobel.gradients(smooth.binomial(frame, 3) if smoothed else frame)
