"""The thesis's geometric errors of a homography and its refinement by each (equations II-18 and A-1 to A-4).

The errors, per point pair x -> x', in squared pixels (Hartley and Zisserman, Multiple View Geometry, chapter 4):

``transfer``      d(x', Hx)^2, in the right image alone
``symmetric``     d(x', Hx)^2 + d(x, H^-1 x')^2
``reprojection``  the smallest d(x, z)^2 + d(x', Hz)^2 over all z: the maximum-likelihood estimate's error
``sampson``       its first-order approximation

Each error is a function ``(h, x, y) -> (residuals (N, k), jacobian (N, k, 8))`` of the eight free elements of H;
the squared residuals of a pair sum to its error.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from golden_model.arrays import Array
from skymosaic.geometry.homography import apply, check_pairs, homogeneous, rescale
from skymosaic.geometry.refinement import joint_normalisation, matrix_of, transfer

Residuals = Callable[[Array, Array, Array], tuple[Array, Array]]

CORRECTION_STEPS = 4
"""Gauss-Newton steps to the nearest exact pair. Each step squares the remaining error; the first is Sampson's."""


def squared_errors(H: Array, left: ArrayLike, right: ArrayLike, *, error: str = "symmetric") -> Array:
    """The error (N,) of every point pair in px²; ``error`` is a name of the module's table.

    Raises
    ------
    ValueError
        For arrays of wrong shape or an unknown error.
    """
    x, y = check_pairs(left, right, minimum=0)
    residuals, _ = _function(error)(rescale(H).ravel()[:8], x, y)
    return np.asarray((residuals**2).sum(axis=1))


def refine(H: Array, left: ArrayLike, right: ArrayLike, *, error: str = "symmetric") -> Array:
    """Minimise the sum of one error by Levenberg-Marquardt with analytic Jacobians.

    Points, result and errors as in `skymosaic.geometry.refinement.refine_robustly`, but without outliers; ``error`` is
    a name of the module's table, and a ValueError if it is unknown.
    """
    function = _function(error)
    x, y = check_pairs(left, right, minimum=4)
    to_x, to_y, _ = joint_normalisation(x, y)
    x, y = apply(to_x, x), apply(to_y, y)
    solution = least_squares(
        lambda h: function(h, x, y)[0].ravel(),
        rescale(to_y @ H @ np.linalg.inv(to_x)).ravel()[:8],
        jac=lambda h: function(h, x, y)[1].reshape(-1, 8),
        method="lm",
    )
    return rescale(np.linalg.inv(to_y) @ matrix_of(solution.x) @ to_x)


def symmetric(h: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Residuals of both directions, (N, 4), and their Jacobian; d(H^-1) = -H^-1 dH H^-1."""
    forward, forward_jacobian = transfer(h, x, y)
    inverse = np.linalg.inv(matrix_of(h))
    mapped = homogeneous(y) @ inverse.T
    projected = mapped[:, :2] / mapped[:, 2:]
    # Derivative of the perspective division, times H^-1; times -dH `mapped` it is the shift of the projected point.
    division = (inverse[None, :2, :] - projected[:, :, None] * inverse[None, 2:, :]) / mapped[:, 2:, None]
    backward_jacobian = -(division[:, :, :, None] * mapped[:, None, None, :]).reshape(len(x), 2, 9)[:, :, :8]
    return np.hstack([forward, projected - x]), np.concatenate([forward_jacobian, backward_jacobian], axis=1)


def reprojection(h: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Displacement (N, 4) of each pair to the nearest pair that fits H exactly, and its Jacobian.

    The nearest pair is found by Gauss-Newton under the constraint (Sampson's correction, repeated). The Jacobian
    leaves out the sliding along the constraint, which is of second order and orthogonal to the displacement, so
    the gradient of the summed squares is exact.
    """
    moved_x, moved_y = x, y
    for _ in range(CORRECTION_STEPS):
        constraint, by_point, _ = _constraint(h, moved_x, moved_y)
        offset = np.hstack([x - moved_x, y - moved_y])
        multiplier = _whiten(by_point, constraint[..., None] + by_point @ offset[..., None])
        displacement = -(by_point.transpose(0, 2, 1) @ multiplier)[..., 0]
        moved_x, moved_y = x + displacement[:, :2], y + displacement[:, 2:]
    _, by_point, by_h = _constraint(h, moved_x, moved_y)
    return displacement, -by_point.transpose(0, 2, 1) @ _whiten(by_point, by_h)


def sampson(h: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """First-order displacement -J'(JJ')^-1 c of each pair, (N, 4), and its Jacobian.

    c is the constraint that the pair fits H, J its derivative by the pair.
    """
    constraint, by_point, by_h = _constraint(h, x, y)
    multiplier = _whiten(by_point, constraint[..., None])
    mixed = _mixed_derivative(x, y)
    # d[J'm] = dJ' m + J' dm, with JJ' dm = dc - (dJ J' + J dJ') m.
    turned = np.einsum("nipk,ni->npk", mixed, multiplier[..., 0])
    change = by_h - np.einsum("nipk,njp,nj->nik", mixed, by_point, multiplier[..., 0]) - by_point @ turned
    transposed = by_point.transpose(0, 2, 1)
    return -(transposed @ multiplier)[..., 0], -turned - transposed @ _whiten(by_point, change)


def _constraint(h: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """The DLT constraint c = x' (h3 x) - (h1, h2) x, (N, 2), and its derivatives by pair (N, 2, 4) and h (N, 2, 8)."""
    H = matrix_of(h)
    lifted = homogeneous(x)
    mapped = lifted @ H.T
    by_point = np.zeros((len(x), 2, 4))
    by_point[:, :, :2] = y[:, :, None] * H[2, :2] - H[:2, :2]
    by_point[:, 0, 2] = by_point[:, 1, 3] = mapped[:, 2]
    by_h = np.zeros((len(x), 2, 9))
    by_h[:, 0, :3] = by_h[:, 1, 3:6] = -lifted
    by_h[:, :, 6:] = y[:, :, None] * lifted[:, None, :]
    return y * mapped[:, 2:] - mapped[:, :2], by_point, by_h[:, :, :8]


def _mixed_derivative(x: Array, y: Array) -> Array:
    """d²c / d(point pair) dh, (N, 2, 4, 8)."""
    mixed = np.zeros((len(x), 2, 4, 9))
    for row in range(2):
        for axis in range(2):
            mixed[:, row, axis, 3 * row + axis] = -1
            mixed[:, row, axis, 6 + axis] = y[:, row]
        mixed[:, row, 2 + row, 6:] = homogeneous(x)
    return mixed[..., :8]


def _whiten(by_point: Array, columns: Array) -> Array:
    """(JJ')^-1 times ``columns`` for every pair."""
    return np.asarray(np.linalg.solve(by_point @ by_point.transpose(0, 2, 1), columns))


def _function(error: str) -> Residuals:
    functions = {each.__name__: each for each in (transfer, symmetric, reprojection, sampson)}
    if error not in functions:
        raise ValueError(f"error is {error!r}; valid: {', '.join(functions)}")
    return functions[error]
