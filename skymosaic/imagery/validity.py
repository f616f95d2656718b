"""Which pixels of a file show something: those that are neither transparent nor declared to have no data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from skymosaic.imagery.jpeg import TURNS

if TYPE_CHECKING:
    from skymosaic.imagery.decoding import Header


def find_visible(decoded: NDArray[Any], data: bytes, header: Header) -> Pixels | None:
    """Find the pixels that show something.

    Parameters
    ----------
    decoded : ndarray, shape (H, W) or (H, W, 3)
        Upright pixels, without alpha.
    data : bytes
        The file.

    Returns
    -------
    ndarray of uint8, shape (H, W), or None
        255 where something is shown, else 0; None: everywhere, or nowhere, as of an alpha channel that nobody filled.
    """
    if not header.transparent and header.nodata is None and decoded.dtype.kind != "f":
        return None
    shown = np.ones(decoded.shape[:2], np.bool_)
    if header.transparent:
        whole = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        if whole is not None and whole.ndim == 3 and whole.shape[2] == 4:
            # Of TIFF alone, OpenCV turns alpha by itself.
            turn = TURNS.get(header.orientation, np.asarray) if header.kind != "TIFF" else np.asarray
            shown &= turn(whole[..., 3]) > np.iinfo(whole.dtype).max // 2
    if header.nodata is not None or decoded.dtype.kind == "f":
        lacking = ~np.isfinite(decoded) | (decoded == header.nodata)
        shown &= ~(lacking if lacking.ndim == 2 else lacking.all(axis=2))
    return None if shown.all() or not shown.any() else shown.astype(np.uint8) * np.uint8(255)


def fill_hidden(pixels: NDArray[np.generic], visible: Pixels) -> NDArray[np.generic]:
    """Give each pixel that shows nothing the value of the nearest one that does, so that no filter sees an edge."""
    _, labels = cv2.distanceTransformWithLabels(255 - visible, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    nearest = np.zeros(labels.max() + 1, np.intp)
    nearest[labels[visible > 0]] = np.flatnonzero(visible)
    return np.asarray(pixels.reshape(-1, *pixels.shape[2:])[nearest[labels]])
