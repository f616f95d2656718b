"""Gray from colour, with the luma weights of thesis equation IV-1 as multiples of 1/256."""

import cv2
import numpy as np
from numpy.typing import NDArray

RED, GREEN, BLUE = 77, 150, 29
"""0.299, 0.587 and 0.114 in 1/256; they add up to 256, so white stays 255."""


def to_gray(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """``(77 R + 150 G + 29 B + 128) >> 8``; a gray image is returned unchanged.

    Parameters
    ----------
    image : ndarray of uint8, shape (H, W) or (H, W, 3) in BGR order

    Returns
    -------
    ndarray of uint8, shape (H, W)

    Raises
    ------
    ValueError
        If type or shape is not one of these.
    """
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(
            f"the image is {image.dtype} of shape {image.shape}; give uint8 of shape (H, W) or (H, W, 3) BGR"
        )
    if image.ndim == 2:
        return image
    blue, green, red = (channel.astype(np.uint16) for channel in cv2.split(image))
    # 256 * 255 + 128 is below 2**16: no step overflows.
    luma: NDArray[np.uint16] = (blue * BLUE + green * GREEN + red * RED + 128) >> 8
    return luma.astype(np.uint8)
