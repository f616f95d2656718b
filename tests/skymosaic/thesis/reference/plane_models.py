"""The thesis's plane transformations between similarity and homography, which nothing else needs (II-12 and II-14)."""

import numpy as np
from numpy.typing import ArrayLike

from golden_model.arrays import Array
from skymosaic.geometry.homography import apply, check_pairs, estimate_similarity, homogeneous, normalisation
from tests.skymosaic.thesis.reference.least_squares import solve_least_squares


def estimate_isometry(left: ArrayLike, right: ArrayLike) -> Array:
    """Fit turn and translation with the least transfer error; parameters as of `estimate_similarity`."""
    x, y = check_pairs(left, right, minimum=2)
    linear = estimate_similarity(x, y)[:2, :2]
    linear = linear / np.sqrt(np.linalg.det(linear))
    shift = y.mean(axis=0) - linear @ x.mean(axis=0)
    return np.vstack([np.column_stack([linear, shift]), [0.0, 0.0, 1.0]])


def estimate_affine(left: ArrayLike, right: ArrayLike) -> Array:
    """Fit an affine transformation with the least transfer error, of at least 3 pairs."""
    x, y = check_pairs(left, right, minimum=3)
    # Normalising the left points suffices: the right ones are only on the other side of the equations.
    to_x = normalisation(x)
    return np.vstack([solve_least_squares(homogeneous(apply(to_x, x)), y).T, [0.0, 0.0, 1.0]]) @ to_x
