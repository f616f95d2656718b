"""The order of a frame's matches: by falling weight."""

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import WEIGHT

BINS = WEIGHT.max_raw + 1
"""Number of different weights: the hardware sorts by counting."""


def order(weight: NDArray[np.integer]) -> NDArray[np.int64]:
    """Indices (N,) of the matches by falling weight, those with equal weights in their order."""
    return np.argsort(-np.asarray(weight, dtype=np.int64), kind="stable")
