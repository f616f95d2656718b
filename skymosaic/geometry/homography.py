"""Plane transformations, and linear estimation of them from point pairs.

A homography is a (3, 3) float64 matrix that maps left pixels to right pixels, x' = Hx; pixel centres are at
integers, x points to the right and y down. It is scaled to H[2, 2] = 1. Where the third coordinate of Hx is
positive, the point lies on the same side of the camera as the left image's first pixel.
"""

import numpy as np
from numpy.typing import ArrayLike

from golden_model.arrays import Array, Matrix, Points

RANK_TOLERANCE = 1e-10
"""A system is degenerate if the singular value that must not vanish is smaller than this share of the largest."""


class DegenerateError(ValueError):
    """The point pairs do not determine the transformation."""


def rescale(H: Array) -> Array:
    """Scale ``H`` to H[2, 2] = 1.

    Raises
    ------
    DegenerateError
        If H[2, 2] vanishes (the origin maps to infinity) or an element is not finite.
    """
    # Relative to the largest element, because a homography has no scale of its own.
    if not np.isfinite(H).all() or abs(H[2, 2]) <= 1e-14 * np.abs(H).max():
        raise DegenerateError("the homography maps the origin to infinity")
    return np.asarray(H / H[2, 2])


def resize_matrix(factor_x: float, factor_y: float | None = None) -> Matrix:
    """The map (3, 3) from an image's pixel coordinates to those of the image resized by the factors.

    ``factor_y`` defaults to ``factor_x``. Pixel centres are at integers before and after, so the outer corner of pixel
    (0, 0), at (-0.5, -0.5), keeps its position.
    """
    factor_y = factor_x if factor_y is None else factor_y
    return np.array([[factor_x, 0, (factor_x - 1) / 2], [0, factor_y, (factor_y - 1) / 2], [0, 0, 1]])


def apply(H: Array, points: ArrayLike) -> Array:
    """Map points (..., 2) by the homography; points that map to infinity become infinite or NaN."""
    mapped = np.asarray(points, dtype=np.float64) @ H[:, :2].T + H[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(mapped[..., :2] / mapped[..., 2:])


def grid_over(size: tuple[int, int], count: int) -> Points:
    """Positions (count², 2) spread over an image of ``size`` (width, height), from its first pixel to its last one."""
    axes = (np.linspace(0, side - 1, count) for side in size)
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def transfer_error(H: Array, left: ArrayLike, right: ArrayLike) -> Array:
    """Distances (N,) in the right image between mapped left points and right points, (N, 2) each, px."""
    return np.asarray(np.linalg.norm(apply(H, left) - np.asarray(right, dtype=np.float64), axis=-1))


def dlt(left: ArrayLike, right: ArrayLike) -> Array:
    """Normalised direct linear transformation: the smallest singular vector of A h = 0 (thesis, equation III-8).

    Both point sets are first centred and scaled to a mean distance of sqrt(2) from their centroid (Hartley 1997).

    Parameters
    ----------
    left, right : (N, 2) array_like
        Corresponding points, px; at least 4.

    Returns
    -------
    (3, 3) float64 ndarray
        Maps left to right, H[2, 2] = 1.

    Raises
    ------
    DegenerateError
        If there are too few pairs, or they are coincident or collinear.
    ValueError
        For arrays of wrong shape, or values that are not finite.
    """
    x, y = check_pairs(left, right, minimum=4)
    to_x, to_y = normalisation(x), normalisation(y)
    rows = design_matrix(apply(to_x, x), apply(to_y, y))
    # The 9x9 triangle of a QR decomposition has the same singular values and right singular vectors as the tall
    # matrix, so the SVD does not grow with the number of pairs.
    _, singular, vectors = np.linalg.svd(np.linalg.qr(rows, mode="r"))
    if singular[7] <= RANK_TOLERANCE * singular[0]:
        raise DegenerateError("the points do not determine a homography: three of four are collinear")
    return rescale(np.linalg.inv(to_y) @ vectors[-1].reshape(3, 3) @ to_x)


def check_pairs(left: ArrayLike, right: ArrayLike, *, minimum: int) -> tuple[Array, Array]:
    """Check point pairs, and return them as (N, 2) float64 arrays.

    Raises
    ------
    ValueError
        For a wrong shape, or values that are not finite.
    DegenerateError
        For fewer than ``minimum`` pairs.
    """
    x, y = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 2 or x.shape != y.shape:
        raise ValueError(f"point pairs have shapes {x.shape} and {y.shape}; need (N, 2)")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ValueError("point pairs must be finite")
    if len(x) < minimum:
        raise DegenerateError(f"{len(x)} point pairs; at least {minimum} are needed")
    return x, y


def homogeneous(points: Array) -> Array:
    """Points (..., 2) with a third coordinate of 1, (..., 3)."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def normalisation(points: Array) -> Array:
    """The similarity (3, 3) that moves the centroid to 0 and the mean distance from it to sqrt(2)."""
    centre = points.mean(axis=0)
    distance = float(np.linalg.norm(points - centre, axis=1).mean())
    if distance == 0:
        raise DegenerateError("the points coincide")
    scale = np.sqrt(2) / distance
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])


def design_matrix(x: Array, y: Array) -> Array:
    """The two DLT rows of every pair, (2N, 9): [-x, 0, x'x] h = 0 and [0, -x, y'x] h = 0."""
    lifted = homogeneous(x)
    rows = np.zeros((len(x), 2, 9))
    rows[:, 0, :3] = rows[:, 1, 3:6] = -lifted
    rows[:, :, 6:] = y[:, :, None] * lifted[:, None, :]
    return rows.reshape(-1, 9)


def estimate_similarity(left: ArrayLike, right: ArrayLike) -> Array:
    """Fit turn, scale and translation with the least transfer error; parameters as of `dlt`, of at least 2 pairs.

    With complex numbers, about the centroids, x' = a x with a = sum(x' x*) / sum(|x|^2).
    """
    x, y = check_pairs(left, right, minimum=2)
    centre_x, centre_y = x.mean(axis=0), y.mean(axis=0)
    z, target = (x - centre_x) @ [1, 1j], (y - centre_y) @ [1, 1j]
    spread, rotation = np.sum(np.abs(z) ** 2), np.sum(target * z.conj())
    if abs(rotation) <= RANK_TOLERANCE * spread:
        raise DegenerateError("the points coincide, or no rotation relates them")
    a = rotation / spread
    linear = np.array([[a.real, -a.imag], [a.imag, a.real]])
    return np.block([[linear, (centre_y - linear @ centre_x)[:, None]], [np.zeros((1, 2)), np.ones((1, 1))]])
