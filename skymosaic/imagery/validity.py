"""Which pixels of a file show something: those that are neither transparent nor declared to have no data."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels


def find_visible(decoded: NDArray[Any], nodata: float | None) -> Pixels | None:
    """Find the pixels that show something.

    Parameters
    ----------
    decoded : ndarray, shape (H, W), (H, W, 3) or with alpha (H, W, 4)
        Upright pixels.
    nodata : float or None
        The value that pixels without data have.

    Returns
    -------
    ndarray of uint8, shape (H, W), or None
        255 where something is shown, else 0; None: everywhere, or nowhere, as of an alpha channel that nobody filled.
    """
    has_alpha, may_lack = decoded.shape[2:] == (4,), nodata is not None or decoded.dtype.kind == "f"
    if not has_alpha and not may_lack:
        return None
    shown = decoded[..., 3] > np.iinfo(decoded.dtype).max // 2 if has_alpha else np.ones(decoded.shape[:2], np.bool_)
    if may_lack:
        lacking = ~np.isfinite(decoded) | (decoded == nodata)
        shown &= ~(lacking if lacking.ndim == 2 else lacking[..., :3].all(axis=2))
    return None if shown.all() or not shown.any() else shown.astype(np.uint8) * np.uint8(255)


def fill_hidden(pixels: NDArray[np.generic], visible: Pixels) -> NDArray[np.generic]:
    """Give each pixel that shows nothing the value of the nearest one that does, so that no filter sees an edge."""
    _, labels = cv2.distanceTransformWithLabels(255 - visible, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    nearest = np.zeros(labels.max() + 1, np.intp)
    nearest[labels[visible > 0]] = np.flatnonzero(visible)
    return np.asarray(pixels.reshape(-1, *pixels.shape[2:])[nearest[labels]])
