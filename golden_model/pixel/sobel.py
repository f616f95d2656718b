"""Sobel gradients."""

import cv2
import numpy as np
from numpy.typing import NDArray


def gradients(pixels: NDArray[np.uint8]) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Horizontal and vertical 3x3 Sobel gradients, positive where the image brightens to the right and downwards.

    Parameters
    ----------
    pixels : ndarray of uint8, shape (H, W)

    Returns
    -------
    gradient_x, gradient_y : ndarray of int16, shape (H, W)
        Unscaled, `golden_model.formats.GRADIENT`: at most 4 * 255 in magnitude. Unspecified within 1 px of the border
        of the region where ``pixels`` is specified.
    """
    # Both in one pass over the image, in integers; `cv2.Sobel` would take two.
    gradient_x, gradient_y = cv2.spatialGradient(pixels)
    return np.asarray(gradient_x, dtype=np.int16), np.asarray(gradient_y, dtype=np.int16)
