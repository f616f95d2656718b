"""The adaptive threshold (thesis, sections II.2.1.2 and III.6.1.1): steady feature counts without a division.

It moves between frames in the domain of response codes. Harris codes are nearly logarithmic (1024 codes double
the response), so that half the excess of features is a fitting step, at most half an octave a frame. FAST codes
are gray levels, and steps are 64 times smaller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from golden_model.config import LARGEST_THRESHOLD
from golden_model.formats import encode_response


@dataclass(frozen=True)
class Steps:
    """How a threshold moves: by ``excess >> shift``, at most ``largest``, within 1 to ``max_code``."""

    shift: int
    largest: int
    max_code: int


_LARGEST_CODE = {name: int(encode_response(np.array(value))) for name, value in LARGEST_THRESHOLD.items()}
STEPS = {
    "harris": Steps(shift=1, largest=512, max_code=_LARGEST_CODE["harris"]),
    "fast": Steps(shift=7, largest=8, max_code=_LARGEST_CODE["fast"]),
}
"""By detector; the largest code is that of the largest threshold a configuration may have."""


def next_code(code: int, count: int, target: int, detector: str = "harris") -> int:
    """The threshold of the next frame.

    Parameters
    ----------
    code : int
        The threshold of this frame as a response code.
    count : int
        Features of this frame; a frame with more than ``max_features`` counts as ``max_features``.
    target : int
        Features wanted; below ``max_features``, or the threshold never rises out of an overflow.
    detector : {"harris", "fast"}

    Returns
    -------
    int
        A response code, 1 to ``STEPS[detector].max_code``.
    """
    steps = STEPS[detector]
    step = min(max((count - target) >> steps.shift, -steps.largest), steps.largest)
    return min(max(code + step, 1), steps.max_code)
