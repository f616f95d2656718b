"""Robust refinement of a homography over all matches, by the transfer error d(x', Hx) in the right image.

The thesis's other errors (symmetric, reprojection, Sampson) are in `tests/skymosaic/thesis/reference/refinement.py`.
"""

import numpy as np
from numpy.typing import ArrayLike

from golden_model.arrays import Array, Matrix
from skymosaic.geometry.homography import DegenerateError, apply, check_pairs, homogeneous, normalisation, rescale

ROBUST_SCALES_PX = (3.0, 2.1, 1.5, 1.5)
"""Scales of the robust loss, one for each step; they end below the inlier threshold."""


def refine_robustly(H: Array, left: ArrayLike, right: ArrayLike) -> Matrix:
    """Refine by reweighted Gauss-Newton on the transfer error: a step for each scale s, weights 1 / (1 + e²/s²)².

    The weights are those of the Geman-McClure loss, which limits the influence of large errors; shrinking scales
    down-weight outliers (graduated Geman-McClure).

    Parameters
    ----------
    H : (3, 3) array_like
        Start, for instance from `skymosaic.geometry.homography.dlt`.
    left, right : (N, 2) array_like
        Corresponding points, N >= 4, px; outliers may be among them.

    Returns
    -------
    (3, 3) float64 ndarray
        The refined homography, H[2, 2] = 1.

    Raises
    ------
    ValueError
        For arrays of wrong shape or values that are not finite.
    skymosaic.geometry.homography.DegenerateError
        For fewer than 4 pairs or coincident points, or if a step maps a point to infinity.
    """
    x, y = check_pairs(left, right, minimum=4)
    # Normalised coordinates are of magnitude 1, which gives the eight elements of h similar magnitudes.
    to_x, to_y, scale = joint_normalisation(x, y)
    x, y = apply(to_x, x), apply(to_y, y)
    h = rescale(to_y @ H @ np.linalg.inv(to_x)).ravel()[:8]
    for scale_px in ROBUST_SCALES_PX:
        residuals, jacobian = transfer(h, x, y)
        # The square root of the weight multiplies both sides of the least-squares system.
        root = 1 / (1 + (residuals**2).sum(axis=1) / (scale * scale_px) ** 2)
        rows, target = (jacobian * root[:, None, None]).reshape(-1, 8), (residuals * root[:, None]).ravel()
        if not np.isfinite(rows).all():
            raise DegenerateError("the homography maps a point to infinity")
        h = h - np.linalg.lstsq(rows, target, rcond=None)[0]
    return rescale(np.linalg.inv(to_y) @ matrix_of(h) @ to_x)


def transfer(h: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Residuals Hx - x' (N, 2) of point pairs (N, 2), and their Jacobian (N, 2, 8) by the free elements ``h`` of H.

    The error is that of the thesis, equation II-18.
    """
    H = matrix_of(h)
    lifted = homogeneous(x)
    mapped = lifted @ H.T
    projected = mapped[:, :2] / mapped[:, 2:]
    direction = lifted / mapped[:, 2:]
    jacobian = np.zeros((len(x), 2, 9))
    jacobian[:, 0, :3] = jacobian[:, 1, 3:6] = direction
    jacobian[:, :, 6:] = -projected[:, :, None] * direction[:, None, :]
    return projected - y, jacobian[:, :, :8]


def joint_normalisation(x: Array, y: Array) -> tuple[Array, Array, float]:
    """Normalise both point sets by one scale, which keeps errors in proportion; returns two (3, 3) and the scale."""
    to_x, to_y = normalisation(x), normalisation(y)
    scale = float(to_x[0, 0])
    to_y[:2] *= scale / to_y[0, 0]
    return to_x, to_y, scale


def matrix_of(h: Array) -> Matrix:
    """The homography (3, 3) with the free elements ``h`` (8,) and H[2, 2] = 1."""
    return np.append(h, 1.0).reshape(3, 3)
