"""Homographies in fixed point, as they are scored, sent in records and composed for the painter.

Coordinates are those of match records: 1/16 px, unsigned, 16 bits. In units of 2^16 of them, 4096 px, every coordinate
is below 1 and the nine elements of a usual homography have similar magnitudes, so one format serves all nine:
`quantise` scales a homography until its largest element is 2^24 - 1 and rounds the others. A homography's scale is
free, its sign says which points are in front of the camera: those whose third coordinate w is positive.
"""

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from golden_model.formats import POSITION, SQ
from golden_model.records import ELEMENTS

ENTRY = SQ(25)
"""An element of a homography. With an unsigned position of 16 bits it fits one multiplier of 25 x 18 bits."""


def quantise(homographies: Array) -> NDArray[np.int64]:
    """Round homographies (M, 3, 3) of pixels to integers whose largest magnitude is 2^24 - 1.

    Parameters
    ----------
    homographies : (M, 3, 3) float64 ndarray
        They map left to right pixels; points in front of the camera have a positive third coordinate.

    Returns
    -------
    (M, 3, 3) int64 ndarray
        `ENTRY`, halves rounded up.

    Raises
    ------
    ValueError
        For a wrong shape, or a homography that is zero or not finite, with its index.
    """
    H = np.asarray(homographies, dtype=np.float64)
    if H.ndim != 3 or H.shape[1:] != (3, 3):
        raise ValueError(f"homographies have shape {H.shape}; need (M, 3, 3)")
    unit_px = float(1 << POSITION.integer_bits)
    units = np.array([unit_px, unit_px, 1.0])
    scaled = H * units / units[:, np.newaxis]
    largest = np.abs(scaled).max(axis=(1, 2), initial=0)
    wrong = np.flatnonzero(~(np.isfinite(largest) & (largest > 0)))
    if wrong.size:
        raise ValueError(f"homography {wrong[0]} is zero or not finite; leave it out")
    # First to a largest magnitude of 1: the factor for a tiny homography would overflow.
    normalised = scaled / largest[:, np.newaxis, np.newaxis]
    return np.asarray(np.floor(normalised * ENTRY.max_raw + 0.5), dtype=np.int64)


def homography_elements(record: np.void) -> NDArray[np.int64]:
    """The elements (3, 3) of a record of one homography, with their signs."""
    stored = np.array([record[name] for name in ELEMENTS], np.uint32)
    return stored.view(np.int32).astype(np.int64).reshape(3, 3)
