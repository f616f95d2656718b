"""Estimates light that a single exposure per photograph does not describe: a smooth field of gains per channel.

Clouds pass, the ground reflects the sun on one side, and a lens darkens its corners differently in each colour. Where
photographs overlap, all of this shows as differences that change slowly across the photograph.
"""

import numpy as np
from scipy import sparse

from golden_model.arrays import Float32, Mask
from skymosaic.compositing.grid import interpolation, roughness, solve
from skymosaic.compositing.overlaps import Overlaps

GRID = 5, 7
"""Rows and columns of the grid of gains over a photograph."""
NODES = GRID[0] * GRID[1]
LOG_SIGMA = 0.08
"""Expected difference of two cells that show the same ground, as a logarithm; larger ones count less."""
FIELD_SIGMA, STEP_SIGMA = 0.28, 0.18
"""Expected size of the field, as a logarithm, and of its difference between neighbouring nodes."""
ROBUST_SIGMAS = (0.64, 0.32, 0.16, LOG_SIGMA, LOG_SIGMA)
"""Scales of the reweighting. They begin wide, because sunlight looks like an outlier to a field that starts at zero."""
MAX_HELD_OUT_COST = 0.95
"""Fields are used if they lower the robust cost of held-out pairs below this share."""


def estimate_light(overlaps: Overlaps, number: int) -> Float32 | None:
    """Estimate the light fields of a number of photographs from overlaps with what exposures do not explain.

    They are logarithms of gains, (number, 5, 7, 3); None where they do not lower the differences of held-out pairs.
    """
    residual, odd = overlaps.difference, overlaps.pair % 2 == 1
    if not odd.any():
        return None
    nodes = _fit(_design(overlaps, ~odd, number), residual[~odd], number)
    left = residual[odd] - _design(overlaps, odd, number) @ nodes
    # The mean cost, because the median would miss clouds that pass over a few photographs only.
    if _cost(left) > MAX_HELD_OUT_COST * _cost(residual[odd]):
        return None
    return _fit(_design(overlaps, np.ones_like(odd), number), residual, number).reshape(number, *GRID, 3)


def _design(overlaps: Overlaps, chosen: Mask, number: int) -> sparse.csr_array:
    """The matrix (N, number * NODES) that takes the photographs' nodes to gains of i less those of j, in chosen cells.

    Photograph i is darker than j by the residual, so this difference has to equal it.
    """
    count = int(np.count_nonzero(chosen))
    columns, values = np.empty((count, 2, 4), np.int32), np.empty((count, 2, 4), np.float32)
    sides = (overlaps.at_i, overlaps.i, 1), (overlaps.at_j, overlaps.j, -1)
    for side, (places, photograph, sign) in enumerate(sides):
        weights = interpolation(places[chosen], GRID)
        columns[:, side] = weights.indices.reshape(-1, 4) + NODES * photograph[chosen, None]
        values[:, side] = sign * weights.data.reshape(-1, 4)
    starts = np.arange(0, values.size + 1, 8, dtype=np.int32)
    return sparse.csr_array((values.ravel(), columns.ravel(), starts), shape=(count, NODES * number))


def _fit(design: sparse.csr_array, target: Float32, number: int) -> Float32:
    """Nodes (number * NODES, 3) by least squares, iteratively reweighted with Geman and McClure's weights."""
    smooth = np.eye(NODES) / FIELD_SIGMA**2 + roughness(GRID) / STEP_SIGMA**2
    # All in 32 bits: SciPy would convert the whole design for each product with 64 bits.
    prior = sparse.kron(sparse.eye_array(number), smooth, format="csr").astype(np.float32)
    nodes: Float32 = np.zeros((design.shape[1], 3), np.float32)
    weight: Float32 = np.full(len(target), 1 / LOG_SIGMA**2, np.float32)
    for sigma in ROBUST_SIGMAS:
        nodes = solve(design, weight, prior, target, nodes)
        left = design @ nodes
        left -= target
        squared = np.square(left, out=left).mean(axis=1)
        weight = 1 / LOG_SIGMA**2 / (1 + squared / sigma**2) ** 2
    return nodes


def _cost(difference: Float32) -> float:
    """Mean Geman-McClure loss, to which parallax and moving things add at most 1 each."""
    squared = (difference / LOG_SIGMA) ** 2
    return float((squared / (1 + squared)).mean())
