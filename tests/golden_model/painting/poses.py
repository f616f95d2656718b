"""Poses for the tests of the painter."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from golden_model.arrays import Array
from golden_model.geometry.fixed_point import ENTRY, quantise
from golden_model.painting.pose import POSE, UNIT_LOG2


def homography(
    size: tuple[int, int], centre: ArrayLike, *, zoom: float = 1, turn: float = 0, tilt: ArrayLike = (0, 0)
) -> Array:
    """Canvas px to frame px: the frame's middle is at ``centre``, turned by radians; ``tilt`` per px of the canvas."""
    x, y = np.asarray(centre)
    c, s = zoom * np.cos(turn), zoom * np.sin(turn)
    to_frame = np.array([[1, 0, size[0] / 2], [0, 1, size[1] / 2], [0, 0, 1]])
    from_canvas = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1]])
    return to_frame @ np.array([[c, -s, 0], [s, c, 0], [*np.asarray(tilt), 1]]) @ from_canvas


def pose(H: Array) -> NDArray[np.int64]:
    """As a host sets it."""
    return quantise(H[np.newaxis])[0] << POSE.bits - ENTRY.bits


def in_pixels(each: NDArray[np.int64]) -> Array:
    """The homography that a pose's integers stand for."""
    unit = np.array([1 << UNIT_LOG2, 1 << UNIT_LOG2, 1.0])
    return each * unit[:, None] / unit
