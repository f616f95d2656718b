"""The half-size level of the pyramid."""

import numpy as np
from numpy.typing import NDArray


def halve(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Mean of each 2x2 block, ``(a + b + c + d + 2) >> 2``; an odd last row or column is dropped.

    Parameters
    ----------
    gray : ndarray of uint8, shape (H, W)

    Returns
    -------
    ndarray of uint8, shape (H // 2, W // 2)
        Pixel (x, y) covers the full-size pixels 2x, 2x + 1 and 2y, 2y + 1: its centre is at 2(x + 1/2) - 1/2.
    """
    height, width = gray.shape
    even = gray[: height // 2 * 2, : width // 2 * 2]
    # 16 bits: the sum of four pixels needs ten.
    rows = even[0::2].astype(np.uint16) + even[1::2]
    return ((rows[:, 0::2] + rows[:, 1::2] + 2) >> 2).astype(np.uint8)
