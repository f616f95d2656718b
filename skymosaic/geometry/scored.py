"""Ranks PROSAC's samples by the hardware's integer scores (`hdl.geometry.scoring`)."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Points
from golden_model.formats import POSITION
from golden_model.geometry.scoring import MAX_MATCHES, Scores, quantise, score
from skymosaic.geometry.prosac import Scorer

Integers = NDArray[np.int64]
Score = Callable[[Integers, Integers, Integers, Integers], Scores]
"""Scores hypotheses, given left positions, right positions and weights."""


def integer_scorer(left: Points, right: Points, weight: Array, *, score: Score = score) -> Scorer:
    """Make the scorer in the hardware's integers, for `skymosaic.geometry.prosac.estimate_homography`.

    Positions are rounded to 1/16 px and weights to integers, as they already are in match records. Matches outside the
    range of positions do not count, nor those beyond the 2048 that the hardware stores, which have the lowest weights.

    Parameters
    ----------
    left, right : (N, 2) float64 ndarray
        Matched points, px, in order of falling weight.
    weight : (N,) float64 ndarray
        0 to 255.
    score : callable
        The golden model, or a simulation of the hardware.

    Returns
    -------
    Scorer
        Hypotheses without a score get 0.
    """
    x, y = (np.floor(points * POSITION.one + 0.5).astype(np.int64) for points in (left, right))
    positions = np.hstack((x, y))
    stored = np.flatnonzero(((positions >= 0) & (positions <= POSITION.max_raw)).all(axis=1))[:MAX_MATCHES]
    matches = x[stored], y[stored], np.rint(weight[stored]).astype(np.int64)

    return lambda homographies: score(quantise(homographies), *matches).score.astype(np.float64)
