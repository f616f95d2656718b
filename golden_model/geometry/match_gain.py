"""How well a homography fits a match, in integers and without a division; `hdl.geometry.match_gain` equals it.

A homography has the elements of `golden_model.geometry.fixed_point`, a match the positions of its record. The match is
at an error e = (n - x'w) / w, where n and w are linear in the left position and x' is the right one. With tau = 3 px
its gain is the truncated quadratic 32 (1 - e² / 2tau²), rounded up to a whole number, which needs only comparisons of
(n - x'w)² with multiples of w². All widths follow from the largest magnitudes below (``MAX_...``).
"""

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import POSITION, SQ, round_shift
from golden_model.geometry.fixed_point import ENTRY

TOLERANCE_PX = 3
LEVEL_BITS = 5
LEVELS = 1 << LEVEL_BITS
"""Steps of the gain between error 0 and sqrt(2) ``TOLERANCE_PX``. With 16 steps, a pair with relief, where the seed
decides between two planes, got the wrong plane more often than in floating point; with 32, as often (measured)."""

TERM_SHIFT = 18
"""Bits that x'w, y'w and w drop before the right position is multiplied."""
ERROR_SHIFT = 13
DEPTH_SHIFT = 7
"""Bits that n - x'w and w drop before they are squared. With the 16 bits of the position, both then have the same
unit up to a factor, which `DEPTH_FACTOR` and `ERROR_FACTOR` restore."""
ERROR = SQ(18)
"""n - x'w is limited to this range before it is squared; the limit is beyond the tolerance for every w."""
ERROR_FACTOR, DEPTH_FACTOR = 8, 9
"""e² < 2tau² where 8 (n - x'w)² < 9 w², in the units after the shifts: 9/8 = 2 (3 * 16)² / 2^12."""

MAX_SUM = -ENTRY.min_raw * (2 * POSITION.max_raw + (1 << POSITION.bits))
MAX_TERM = MAX_SUM + (1 << TERM_SHIFT - 1) >> TERM_SHIFT
MAX_DEPTH = MAX_TERM >> DEPTH_SHIFT
MAX_MISS = MAX_TERM * ((1 << POSITION.bits) + POSITION.max_raw)
MAX_SQUARED_ERROR = ERROR_FACTOR * 2 * ERROR.min_raw**2
MAX_SQUARED_DEPTH = DEPTH_FACTOR * MAX_DEPTH**2


def gain(h: NDArray[np.int64], left: NDArray[np.int64], right: NDArray[np.int64]) -> NDArray[np.int64]:
    """Gain (M, N) of N matches under M homographies, 0 to `LEVELS`."""
    x, y = left.T
    sums = h[:, :, :1] * x + h[:, :, 1:2] * y + (h[:, :, 2:] << POSITION.bits)
    terms = round_shift(sums, TERM_SHIFT)
    w = terms[:, 2:]
    miss = (terms[:, :2] << POSITION.bits) - right.T * w
    error = np.clip(miss >> ERROR_SHIFT, ERROR.min_raw, ERROR.max_raw)
    depth = np.maximum(w[:, 0] >> DEPTH_SHIFT, 0)
    squared_error = ERROR_FACTOR * (error**2).sum(axis=1)
    squared_depth = DEPTH_FACTOR * depth**2
    gains = np.zeros(depth.shape, dtype=np.int64)
    near = squared_error < squared_depth
    # Rounded up to a whole step, so that a match at the edge of the tolerance still counts.
    gains[near] = LEVELS - (LEVELS * squared_error[near]) // squared_depth[near]
    return gains
