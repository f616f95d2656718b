"""Columns of pixels as the line memories give them."""

import numpy as np
from numpy.typing import NDArray


def columns(plane: NDArray[np.generic], lines: int) -> NDArray[np.generic]:
    """For each pixel, itself and the ``lines - 1`` above it, in this order; pixels above the frame are arbitrary."""
    above = np.pad(plane, ((lines - 1, 0), (0, 0)), mode="reflect")
    return np.stack([above[lines - 1 - n : len(above) - n] for n in range(lines)], axis=-1)
