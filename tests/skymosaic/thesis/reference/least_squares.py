"""The thesis's second linear estimate of a homography, beside the DLT."""

import numpy as np
from numpy.typing import ArrayLike

from golden_model.arrays import Array
from skymosaic.geometry.homography import (
    RANK_TOLERANCE,
    DegenerateError,
    apply,
    check_pairs,
    design_matrix,
    normalisation,
    rescale,
)


def estimate_inhomogeneous(left: ArrayLike, right: ArrayLike) -> Array:
    """Estimate by the eight-parameter least squares h = (A'A)^-1 A'b with h33 = 1 (thesis, equation III-9).

    Parameters, result and errors as in `skymosaic.geometry.homography.dlt`. h33 is fixed in normalised
    coordinates, where it is the third coordinate of the centroid, so that it cannot vanish.
    """
    x, y = check_pairs(left, right, minimum=4)
    to_x, to_y = normalisation(x), normalisation(y)
    rows = design_matrix(apply(to_x, x), apply(to_y, y))
    h = solve_least_squares(rows[:, :8], -rows[:, 8])
    return rescale(np.linalg.inv(to_y) @ np.append(h, 1.0).reshape(3, 3) @ to_x)


def solve_least_squares(rows: Array, target: Array) -> Array:
    """Solve ``rows @ h = target`` by least squares.

    Raises
    ------
    DegenerateError
        If the system is rank-deficient.
    """
    solution, _, rank, _ = np.linalg.lstsq(rows, target, rcond=RANK_TOLERANCE)
    if rank < rows.shape[1]:
        raise DegenerateError("the points do not determine the transformation: too many are collinear")
    return np.asarray(solution)
