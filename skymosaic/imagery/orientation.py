"""How photographs and frames are turned upright: by EXIF's orientation, or by a matrix."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from golden_model.arrays import Matrix

UPRIGHT, MIRROR = 1, 5
AXES: dict[int, ArrayLike] = {
    UPRIGHT: ((1, 0), (0, 1)),
    2: ((-1, 0), (0, 1)),
    3: ((-1, 0), (0, -1)),
    4: ((1, 0), (0, -1)),
    MIRROR: ((0, 1), (1, 0)),
    6: ((0, -1), (1, 0)),
    7: ((0, -1), (-1, 0)),
    8: ((0, 1), (-1, 0)),
}
"""How EXIF's orientations turn directions in stored photographs, x and y, to those in upright ones."""


def turn_pixels(stored: NDArray[Any], axes: ArrayLike) -> NDArray[Any]:
    """Turn and mirror pixels as ``axes`` turn directions, x and y, by the nearest quarter."""
    (right, from_down), (from_right, down) = np.asarray(axes)
    if abs(from_right) > abs(right):
        stored, right, down = stored.swapaxes(0, 1), from_down, from_right
    return np.ascontiguousarray(stored[:: -1 if down < 0 else 1, :: -1 if right < 0 else 1])


def turn_matrix(size: tuple[int, int], axes: ArrayLike) -> Matrix:
    """The map (3, 3) from stored pixels to those of the upright photograph, whose ``size`` is width and height."""
    turned, axes = np.eye(3), np.asarray(axes)
    turned[:2, :2], turned[:2, 2] = axes, np.where(axes.sum(axis=1) < 0, np.array(size) - 1, 0)
    return turned
