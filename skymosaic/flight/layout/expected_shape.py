"""What shape a transformation of a view has: expected over flat ground, and possible for a camera at all.

The ties alone leave some motions open, above all a bending of the whole mosaic. A prior decides these: over flat
ground a camera that looks down sees a similarity, except for a little tilt and the stretch that follows from it.
The stretch and tilt of all views thereby define the ground plane.
"""

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from skymosaic.flight.layout.motions import shapes, stretch_of_tilt

STRETCH_SIGMA = 1e-3
"""Expected stretch beside what the tilt explains."""
STRETCH_ERROR = 0.2
"""Standard deviation of the stretch that the tilt explains, as a share of it: the focal length is hardly known."""
TILT_SIGMA = 0.05
"""Expected perspective: the tangent of the tilt over the focal length in half diagonals; about 3 degrees."""
MAX_STRETCH = 0.9
"""Stretch of a camera that leans by 87 degrees; from 1 on it would see the ground as in a mirror."""
MIN_AREA = 1e-6
"""Smallest area of a view on the ground, where that of the reference is 1; its inverse is the largest."""


def expect(transforms: Array, count: int) -> Array:
    """How exactly the first ``count`` of stretch and tilt are expected at transformations: one over the variances.

    (V, 3, 3) to (V, count), of which a model leaves so many free.
    """
    measured = shapes(transforms)
    explained = np.linalg.norm(stretch_of_tilt(measured[:, 2:]), axis=1)
    sigma = np.maximum(TILT_SIGMA, np.abs(measured))
    sigma[:, :2] = np.hypot(STRETCH_SIGMA, STRETCH_ERROR * explained)[:, None]
    return np.asarray(1 / sigma[:, :count] ** 2)


def differences(transforms: Array, count: int) -> Array:
    """The first ``count`` of stretch beside what the tilt explains, and of tilt, (V, count)."""
    measured = shapes(transforms)
    measured[:, :2] -= stretch_of_tilt(measured[:, 2:])
    return np.asarray(measured[:, :count])


def are_possible(transforms: Array) -> NDArray[np.bool_]:
    """Which transformations (V, 3, 3) of normalised coordinates a camera can have: finite, upright, of sane size."""
    with np.errstate(all="ignore"):
        # Of a homography scaled to H[2, 2] = 1, the determinant is the area on the ground of what lies in the middle.
        area = np.linalg.det(transforms)
        stretch = np.linalg.norm(shapes(transforms)[:, :2], axis=1)
    return np.asarray((stretch < MAX_STRETCH) & (area > MIN_AREA) & (area < 1 / MIN_AREA))
