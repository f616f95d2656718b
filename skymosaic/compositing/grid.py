"""A coarse grid of values over an image: bilinear interpolation, roughness, and the values that explain others."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from golden_model.arrays import Array, Float32, Points

Values = TypeVar("Values", Array, Float32)

MAX_STEPS, TOLERANCE = 200, 1e-3
"""Steps of conjugate gradients, and the residual at which they end, as a share of the target."""


def nodes_around(places: Points | Float32, shape: tuple[int, int]) -> tuple[NDArray[np.int32], Array | Float32]:
    """The four nodes around each place of an image, row by row, and their bilinear weights, (N, 4) each.

    Parameters
    ----------
    places : ndarray of float64 or float32, shape (N, 2)
        From (0, 0) at the image's first pixel to (1, 1) at its last one; clipped to the image.
    shape : (int, int)
        Rows and columns of the grid, at least 2. The outermost nodes are at the image's corner pixels.
    """
    rows, columns = shape
    position = np.clip(places, 0, 1) * np.array([columns - 1, rows - 1], places.dtype)
    first = np.minimum(position.astype(np.int32), np.array([columns - 2, rows - 2], np.int32))
    across, down = (position - first.astype(places.dtype)).T
    nodes = (columns * first[:, 1] + first[:, 0])[:, None] + np.array([0, 1, columns, columns + 1], np.int32)
    return nodes, np.stack(((1 - across) * (1 - down), across * (1 - down), (1 - across) * down, across * down), axis=1)


def interpolation(places: Points | Float32, shape: tuple[int, int]) -> sparse.csr_array:
    """Weights (N, rows * columns) of all nodes at places of an image; see `nodes_around`."""
    nodes, weights = nodes_around(places, shape)
    starts = np.arange(0, 4 * len(places) + 1, 4, dtype=np.int32)
    return sparse.csr_array((weights.ravel(), nodes.ravel(), starts), shape=(len(places), shape[0] * shape[1]))


def roughness(shape: tuple[int, int]) -> Array:
    """The quadratic form (nodes, nodes) of the sum of squared differences between neighbouring nodes."""
    nodes = np.eye(shape[0] * shape[1]).reshape(*shape, -1)
    differences = np.concatenate([np.diff(nodes, axis=axis).reshape(-1, nodes.shape[2]) for axis in (0, 1)])
    return np.asarray(differences.T @ differences)


def solve(design: sparse.csr_array, weight: Values, prior: sparse.csr_array, target: Values, start: Values) -> Values:
    """Values (nodes, C) by weighted least squares and conjugate gradients, scaled by the diagonal.

    ``design`` (N, nodes) takes them to ``target`` (N, C), with weights (N,); ``prior``, a quadratic form,
    (nodes, nodes), holds them back.
    """

    def multiply(nodes: Values) -> Values:
        return np.asarray(design.T @ (weight * (design @ nodes)) + prior @ nodes)

    # The matrix itself would take most of a megabyte per photograph, and a direct solution tens of seconds.
    system = LinearOperator(prior.shape, multiply, dtype=prior.dtype)
    # Unlike `design.power(2)`, this shares the indices of the design.
    diagonal = sparse.csr_array((design.data**2, design.indices, design.indptr), design.shape).T @ weight
    scale = sparse.diags_array(1 / (diagonal + prior.diagonal()))
    return np.column_stack(
        [
            cg(system, design.T @ (weight * channel), x0=first, rtol=TOLERANCE, maxiter=MAX_STEPS, M=scale)[0]
            for channel, first in zip(target.T, start.T, strict=True)
        ]
    )
