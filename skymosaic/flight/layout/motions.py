"""How points of a view move: by small motions of its pixels, and with the distortion of the lens.

Coordinates are normalised: centred, in half diagonals of the view.
"""

import numpy as np

from golden_model.arrays import Array

FOCAL_HALF_DIAGONALS = 1.2
"""Focal length in half diagonals of the view: common drones have 1.1 to 1.3."""
STRAIGHTENING_ROUNDS = 12
NO_DISTORTION = np.zeros(0)


def generators(points: Array, count: int) -> Array:
    """How each of the first ``count`` motions moves each point: (..., 2) to (..., 2, count).

    Right, down, turn, grow; stretch along the axes and along the diagonals; tilt about y and about x.
    """
    x, y = points[..., 0], points[..., 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    along_x = (one, zero, -y, x, x, y, -x * x, -x * y)
    along_y = (zero, one, x, y, -y, x, -x * y, -y * y)
    # In memory, all points of a motion follow each other: calculations with short rows take twice the time.
    return np.moveaxis(np.array([along_x[:count], along_y[:count]]), (0, 1), (-2, -1))


def shapes(transforms: Array) -> Array:
    """Stretch along the axes, along the diagonals, and tilt about y and x of each view at its centre, (V, 4)."""
    scaled = transforms / transforms[:, 2:, 2:]
    tilt = scaled[:, 2, :2]
    affine = scaled[:, :2, :2] - scaled[:, :2, 2:] * tilt[:, None, :]
    # As complex numbers, an affine map is z -> similar z + stretching z*; their quotient is seen by the view itself.
    similar = affine[:, 0, 0] + affine[:, 1, 1] + 1j * (affine[:, 1, 0] - affine[:, 0, 1])
    stretching = affine[:, 0, 0] - affine[:, 1, 1] + 1j * (affine[:, 1, 0] + affine[:, 0, 1])
    stretch = stretching / similar
    return np.column_stack([stretch.real, stretch.imag, tilt])


def stretch_of_tilt(tilt: Array) -> Array:
    """Stretch (V, 2), as `shapes` measures it, of a camera whose tilt (V, 2) is the only one it has.

    A camera that leans by an angle a sees a tilt of tan(a) / f, and along it a stretch of tan²(a / 2).
    """
    leaning = FOCAL_HALF_DIAGONALS * (tilt[:, 0] + 1j * tilt[:, 1])
    stretch = leaning**2 / (1 + np.sqrt(1 + np.abs(leaning) ** 2)) ** 2
    return np.column_stack([stretch.real, stretch.imag])


def to_transforms(motion: Array) -> Array:
    """The transformations (V, 3, 3) of small motions (V, 8)."""
    right, down, turn, grow, axes, diagonals, tilt_x, tilt_y = motion.T
    one = np.ones_like(right)
    rows = [
        [1 + grow + axes, diagonals - turn, right],
        [diagonals + turn, 1 + grow - axes, down],
        [tilt_x, tilt_y, one],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def straighten(points: Array, distortion: Array) -> Array:
    """Take the distortion of the lens out of points (..., 2) about the middle, in half diagonals.

    The distortion is nothing, k1, k1 and k2 of OpenCV's model, with half diagonals for focal lengths, or these and the
    centre of the lens. A point at distance r from the centre was displaced outwards by k1 r² + k2 r⁴ of it.
    """
    if not distortion.any():
        return points
    k1, k2, *centre = np.pad(distortion, (0, 4 - len(distortion)))
    bent = straight = points - centre
    # A fixed-point iteration: the model gives the bent radius from the straight one, and has no simple inverse.
    for _ in range(STRAIGHTENING_ROUNDS):
        before, squared = straight, squared_lengths(straight)
        straight = bent / (1 + squared * (k1 + squared * k2))
        if np.array_equal(before, straight):
            break
    return np.asarray(straight + centre)


def bending_of(straight: Array, distortion: Array) -> Array:
    """How straightened points (..., 2) move with each term of the distortion, (..., 2, terms)."""
    k1, k2, *centre = np.pad(distortion, (0, 4 - len(distortion)))
    from_centre = straight - centre
    squared = squared_lengths(from_centre)
    # How a small step from the centre, and one around it, was stretched.
    along, around = 1 + squared * (3 * k1 + squared * 5 * k2), 1 + squared * (k1 + squared * k2)
    radial = -from_centre * squared / along
    terms = np.stack([radial, radial * squared], axis=-1)
    if len(distortion) > 2:
        turned = ((2 * k1 + 4 * k2 * squared) / (along * around) * from_centre)[..., None] * from_centre[..., None, :]
        terms = np.concatenate([terms, (1 - 1 / around)[..., None] * np.eye(2) + turned], axis=-1)
    return terms[..., : len(distortion)]


def squared_lengths(vectors: Array) -> Array:
    """Squared lengths (..., 1) of vectors (..., 2); numpy's sum along so short an axis takes ten times as long."""
    return np.asarray(vectors[..., :1] ** 2 + vectors[..., 1:] ** 2)


def multiply_small(left: Array, right: Array) -> Array:
    """Products of matrices (..., 2, 2) and (..., 2, k); numpy's own takes several times as long for so small ones."""
    return np.asarray(left[..., :1] * right[..., :1, :] + left[..., 1:] * right[..., 1:, :])
