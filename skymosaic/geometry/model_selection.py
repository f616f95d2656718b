"""Locates a small object from few matches: by a similarity, or by a homography where the matches justify one."""

from typing import NamedTuple

import numpy as np

from golden_model.arrays import Array
from skymosaic.geometry.homography import DegenerateError, estimate_similarity, transfer_error
from skymosaic.geometry.prosac import estimate_homography

TOLERANCE_PX = 3.0
"""A match with at most this error supports a transformation."""
MAX_TRIED = 60
"""Similarities are tried from all pairs among this many matches, those with the largest weights."""
MIN_BASE_PX = 10.0
"""Two matches closer than this do not determine scale and rotation well enough."""
NOISE_PX = 1.0
"""Expected error of a match, for the choice of the model."""
PARAMETERS = {"similarity": 4, "projective": 8}


class Fit(NamedTuple):
    """A transformation ``matrix`` (3, 3), left to right, its ``model`` and how many matches lie within 3 px."""

    matrix: Array
    model: str
    inliers: int


def fit(left: Array, right: Array, weight: Array, *, fewest: int, rng: np.random.Generator) -> Fit | None:
    """Fit a similarity or a homography, whichever explains the matches better.

    A homography needs 12 matches within 2 px, and its four additional parameters must pay off by Torr's geometric
    robust information criterion (Geometric motion segmentation and model selection, 1998). Wrong matches may be among
    the points (N, 2); ``weight`` (N,) is the positive confidence of each. None with fewer than ``fewest`` inliers.
    """
    fits = [fit_similarity(left, right, weight, fewest=fewest)]
    projective = estimate_homography(left, right, weight, rng=rng, restarts=1).homography
    if projective is not None:
        inliers = int(np.count_nonzero(transfer_error(projective, left, right) <= TOLERANCE_PX))
        fits.append(Fit(projective, "projective", inliers) if inliers >= fewest else None)
    return min((each for each in fits if each), key=lambda each: _criterion(each, left, right), default=None)


def fit_similarity(left: Array, right: Array, weight: Array, *, fewest: int) -> Fit | None:
    """Find the similarity through two matches with the most weighted support, and refit it to its inliers.

    Arguments and result as in `fit`. With few matches every pair can be tried, so there is no random sampling.
    """
    heaviest = np.argsort(-weight, kind="stable")[:MAX_TRIED]
    x, y = left @ [1, 1j], right @ [1, 1j]
    first, second = heaviest[np.array(np.triu_indices(len(heaviest), 1))]
    apart = np.abs(x[second] - x[first]) > MIN_BASE_PX
    first, second = first[apart], second[apart]
    if first.size == 0:
        return None
    # In complex numbers a similarity is y = a x + b, and two matches determine a, its rotation and scale.
    a = (y[second] - y[first]) / (x[second] - x[first])
    error = np.abs(a[:, None] * (x - x[first, None]) + y[first, None] - y)
    best = np.argmax(np.maximum(0, 1 - (error / TOLERANCE_PX) ** 2) @ weight)
    support = error[best] <= TOLERANCE_PX
    try:
        matrix = estimate_similarity(left[support], right[support])
    except DegenerateError:
        return None
    inliers = int(np.count_nonzero(transfer_error(matrix, left, right) <= TOLERANCE_PX))
    return Fit(matrix, "similarity", inliers) if inliers >= fewest else None


def _criterion(candidate: Fit, left: Array, right: Array) -> float:
    """The information criterion: bounded squared errors plus a penalty per parameter; smaller is better."""
    # A match beyond two standard deviations is an outlier under any model. Each of the N has four coordinates.
    errors = np.minimum((transfer_error(candidate.matrix, left, right) / NOISE_PX) ** 2, 4)
    return float(errors.sum() + PARAMETERS[candidate.model] * np.log(4 * len(left)))
