"""Windows over whole planes.

Every stage keeps the shape of the frame. Where a window leaves the frame, the result is unspecified: hardware and
model may differ there. No feature depends on such pixels (`golden_model.config.FrontEndConfig.min_border_px`).
"""

import cv2
import numpy as np
from numpy.typing import NDArray


def box_sum(plane: NDArray[np.int32], window_px: int) -> NDArray[np.int32]:
    """Sum over the ``window_px`` x ``window_px`` window around each pixel.

    Parameters
    ----------
    plane : ndarray of int32, shape (H, W)
        The sums must fit 32 bits.
    window_px : int, odd

    Returns
    -------
    ndarray of int32, shape (H, W)
        Unspecified within ``window_px // 2`` px of the border of the region where ``plane`` is specified.
    """
    # Not normalised: a mean would be rounded.
    sums = cv2.boxFilter(plane, cv2.CV_32S, (window_px, window_px), normalize=False)
    return np.asarray(sums, dtype=np.int32)
