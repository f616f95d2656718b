"""A coarse grid of values over an image: bilinear interpolation between its nodes, and their roughness."""

import numpy as np
from scipy import sparse

from golden_model.arrays import Array, Float32, Points


def interpolation(places: Points | Float32, shape: tuple[int, int]) -> sparse.csr_array:
    """Bilinear weights (N, rows * columns) of the nodes at places of an image.

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
    weights = np.column_stack(((1 - across) * (1 - down), across * (1 - down), (1 - across) * down, across * down))
    starts = np.arange(0, 4 * len(places) + 1, 4, dtype=np.int32)
    return sparse.csr_array((weights.ravel(), nodes.ravel(), starts), shape=(len(places), rows * columns))


def roughness(shape: tuple[int, int]) -> Array:
    """The quadratic form (nodes, nodes) of the sum of squared differences between neighbouring nodes."""
    index = np.arange(shape[0] * shape[1]).reshape(shape)
    first = np.concatenate((index[:, :-1].ravel(), index[:-1].ravel()))
    second = np.concatenate((index[:, 1:].ravel(), index[1:].ravel()))
    order = np.arange(len(first))
    difference = np.zeros((len(first), index.size))
    difference[order, first], difference[order, second] = 1, -1
    return np.asarray(difference.T @ difference)
