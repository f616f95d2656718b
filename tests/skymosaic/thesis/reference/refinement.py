"""The thesis's geometric errors of a homography and its refinement by each (equations II-18 and A-1 to A-4).

The errors, per point pair x -> x', in squared pixels (Hartley and Zisserman, Multiple View Geometry, chapter 4):

``transfer``      d(x', Hx)^2, in the right image alone
``symmetric``     d(x', Hx)^2 + d(x, H^-1 x')^2
``reprojection``  the smallest d(x, z)^2 + d(x', Hz)^2 over all z: the maximum-likelihood estimate's error
``sampson``       its first-order approximation

Each error is a function ``(H, x, y) -> residuals (N, k)``; the squared residuals of a pair sum to its error.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from golden_model.arrays import Array
from skymosaic.geometry.homography import apply, check_pairs, homogeneous, rescale
from skymosaic.geometry.refinement import joint_normalisation, matrix_of

Residuals = Callable[[Array, Array, Array], Array]

CORRECTION_STEPS = 4
"""Gauss-Newton steps to the nearest exact pair. Each step squares the remaining error; the first is Sampson's."""


def squared_errors(H: Array, left: ArrayLike, right: ArrayLike, error: Residuals) -> Array:
    """One error (N,) of every point pair in px²; a ValueError for arrays of wrong shape."""
    x, y = check_pairs(left, right, minimum=0)
    return np.asarray((error(H, x, y) ** 2).sum(axis=1))


def refine(H: Array, left: ArrayLike, right: ArrayLike, error: Residuals) -> Array:
    """Minimise the sum of one error by Levenberg-Marquardt.

    Points, result and errors as in `skymosaic.geometry.refinement.refine_robustly`, but without outliers.
    """
    x, y = check_pairs(left, right, minimum=4)
    to_x, to_y, _ = joint_normalisation(x, y)
    x, y = apply(to_x, x), apply(to_y, y)
    solution = least_squares(
        lambda h: error(matrix_of(h), x, y).ravel(), rescale(to_y @ H @ np.linalg.inv(to_x)).ravel()[:8], method="lm"
    )
    return rescale(np.linalg.inv(to_y) @ matrix_of(solution.x) @ to_x)


def transfer(H: Array, x: Array, y: Array) -> Array:
    """Displacement (N, 2) in the right image."""
    return apply(H, x) - y


def symmetric(H: Array, x: Array, y: Array) -> Array:
    """Displacements (N, 4) in both images."""
    return np.hstack([apply(H, x) - y, apply(np.asarray(np.linalg.inv(H)), y) - x])


def reprojection(H: Array, x: Array, y: Array) -> Array:
    """Displacement (N, 4) of each pair to the nearest pair that fits H exactly.

    That pair is found by Gauss-Newton under the constraint: Sampson's correction, repeated.
    """
    return _displacement(H, x, y, CORRECTION_STEPS)


def sampson(H: Array, x: Array, y: Array) -> Array:
    """First-order displacement -J'(JJ')^-1 c of each pair, (N, 4).

    c is the constraint that the pair fits H, J its derivative by the pair.
    """
    return _displacement(H, x, y, 1)


def _displacement(H: Array, x: Array, y: Array, steps: int) -> Array:
    displacement = np.zeros((len(x), 4))
    for _ in range(steps):
        constraint, by_pair = _constraint(H, x + displacement[:, :2], y + displacement[:, 2:])
        target = constraint[..., None] - by_pair @ displacement[..., None]
        transposed = by_pair.transpose(0, 2, 1)
        displacement = -(transposed @ np.linalg.solve(by_pair @ transposed, target))[..., 0]
    return displacement


def _constraint(H: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """The DLT constraint c = x' (h3 x) - (h1, h2) x, (N, 2), and its derivative by the pair, (N, 2, 4)."""
    mapped = homogeneous(x) @ H.T
    by_pair = np.zeros((len(x), 2, 4))
    by_pair[:, :, :2] = y[:, :, None] * H[2, :2] - H[:2, :2]
    by_pair[:, 0, 2] = by_pair[:, 1, 3] = mapped[:, 2]
    return y * mapped[:, 2:] - mapped[:, :2], by_pair
