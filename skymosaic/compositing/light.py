"""The light on each photograph that one exposure does not describe: a smooth field of gains for each channel.

Clouds pass, the sun is reflected from one side, and a lens darkens the colours of its corners differently. Where
photographs overlap, all of this shows as differences that change slowly across the photograph.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import cg

from golden_model.arrays import Array
from skymosaic.compositing.overlaps import Overlaps

ROWS, COLUMNS = 5, 7
NODES = ROWS * COLUMNS
"""Of the grid of gains, at the corners of the photograph and between them; bilinear in between."""
LOG_SIGMA = 0.08
"""Expected difference of two cells that show the same ground, as a logarithm; larger ones count less."""
FIELD_SIGMA, STEP_SIGMA = 0.28, 0.18
"""Expected size of the field, as a logarithm, and of its difference between neighbouring nodes."""
ROBUST_SIGMAS = (0.64, 0.32, 0.16, LOG_SIGMA, LOG_SIGMA)
"""Scales of the reweighting: a field that starts at zero must not take sunlight for an outlier."""
STEPS, CLOSE_ENOUGH = 200, 1e-3
"""Of conjugate gradients: steps at most, and the share of the target's size that may be left."""
HELD_OUT_GAIN = 0.95
"""Fields are used if they lower the robust cost of pairs they were not fitted to below this share."""


def estimate_light(overlaps: Overlaps, residual: Array, number: int) -> Array | None:
    """The fields that explain what exposures leave.

    Parameters
    ----------
    overlaps : Overlaps
    residual : ndarray of float64, shape (N, 3)
        What is left of their difference.
    number : int
        Of photographs.

    Returns
    -------
    ndarray of float64, shape (number, 5, 7, 3), or None
        Logarithms of gains; None where they do not lower the differences of pairs that were held out.
    """
    odd = overlaps.pair % 2 == 1
    if odd.all() or not odd.any():
        return None
    # Photograph i is darker than j by the residual, so i's gain less j's gain has to be that.
    columns = _columns(overlaps.i, overlaps.at_i, number) - _columns(overlaps.j, overlaps.at_j, number)
    left = residual[odd] - columns[odd] @ _fitted(columns[~odd], residual[~odd], number)
    # Not the median: clouds may pass over a few photographs only.
    if _cost(left) > HELD_OUT_GAIN * _cost(residual[odd]):
        return None
    return _fitted(columns, residual, number).reshape(number, ROWS, COLUMNS, 3)


def _columns(photograph: NDArray[np.intp], places: Array, number: int) -> sparse.csr_array:
    """Bilinear weights (N, number * NODES) of the nodes at places of photographs."""
    position = np.clip(places, 0, 1) * [COLUMNS - 1, ROWS - 1]
    first = np.minimum(position.astype(np.intp), [COLUMNS - 2, ROWS - 2])
    across, down = (position - first).T
    corners = (NODES * photograph + COLUMNS * first[:, 1] + first[:, 0])[:, None] + [0, 1, COLUMNS, COLUMNS + 1]
    weights = np.column_stack(((1 - across) * (1 - down), across * (1 - down), (1 - across) * down, across * down))
    starts = np.arange(0, 4 * len(places) + 1, 4)
    return sparse.csr_array((weights.ravel(), corners.ravel(), starts), shape=(len(places), NODES * number))


def _fitted(columns: sparse.csr_array, wanted: Array, number: int) -> Array:
    """Nodes (number * NODES, 3), by least squares that are reweighted with Geman and McClure's weights."""
    expected = sparse.kron(sparse.eye_array(number), _smoothness(), format="csr")
    nodes, weight = np.zeros((columns.shape[1], 3)), np.full(len(wanted), 1 / LOG_SIGMA**2)
    for sigma in ROBUST_SIGMAS:
        weighted = columns.T.multiply(weight).tocsr()
        nodes = _solved((weighted @ columns + expected).tocsr(), weighted @ wanted, nodes)
        squared = ((wanted - columns @ nodes) ** 2).mean(axis=1)
        weight = 1 / LOG_SIGMA**2 / (1 + squared / sigma**2) ** 2
    return nodes


def _cost(difference: Array) -> float:
    """Geman and McClure's, to which parallax and moving things add at most 1 each."""
    squared = (difference / LOG_SIGMA) ** 2
    return float((squared / (1 + squared)).mean())


def _smoothness() -> Array:
    """The quadratic form of one photograph's nodes and of the differences between neighbours."""
    form = np.eye(NODES) / FIELD_SIGMA**2
    index = np.arange(NODES).reshape(ROWS, COLUMNS)
    for first, second in ((index[:, :-1], index[:, 1:]), (index[:-1], index[1:])):
        difference = np.zeros((first.size, NODES))
        order = np.arange(first.size)
        difference[order, first.ravel()], difference[order, second.ravel()] = 1, -1
        form += difference.T @ difference / STEP_SIGMA**2
    return form


def _solved(system: sparse.csr_array, target: Array, start: Array) -> Array:
    """Conjugate gradients for each channel, scaled by the diagonal: a direct solution takes tens of seconds."""
    scale = sparse.diags_array(1 / system.diagonal())
    return np.column_stack(
        [
            cg(system, wanted, x0=first, rtol=CLOSE_ENOUGH, maxiter=STEPS, M=scale)[0]
            for wanted, first in zip(target.T, start.T, strict=True)
        ]
    )
