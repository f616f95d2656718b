"""Binomial smoothing: 3x3 before the gradients, 5x5 before the descriptor."""

import cv2
import numpy as np

from golden_model.arrays import Pixels


def binomial(gray: Pixels, window_px: int) -> Pixels:
    """``[1 2 1]`` or ``[1 4 6 4 1]`` in x and y, divided by 16 or 256 with halves rounded up.

    Parameters
    ----------
    gray : ndarray of uint8, shape (H, W)
    window_px : {3, 5}

    Returns
    -------
    ndarray of uint8, shape (H, W)
        Unspecified within ``window_px // 2`` px of the border.
    """
    # For uint8, sigma 0 and size 3 or 5, OpenCV's Gaussian blur is exactly the binomial, rounded once at the end. The
    # hint is needed: without it OpenCV may use a faster, approximate version.
    smoothed = cv2.GaussianBlur(gray, (window_px, window_px), 0, hint=cv2.ALGO_HINT_ACCURATE)
    return np.asarray(smoothed, dtype=np.uint8)
