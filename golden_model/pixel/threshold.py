"""The adaptive threshold (thesis, sections II.2.1.2 and III.6.1.1): keeps the number of features near a target.

It changes between frames, in units of response codes, and needs no division. Harris codes are nearly logarithmic: 1024
codes double the response. A step of half the excess of features, at most 512 codes (half an octave) per frame, suits
them. FAST codes are gray levels, where steps must be 64 times smaller.
"""

from dataclasses import dataclass

import numpy as np

from golden_model.config import MAX_THRESHOLD
from golden_model.formats import encode_response


@dataclass(frozen=True)
class Steps:
    """Steps of a threshold: ``excess >> shift``, at most ``max_step`` in size, within codes 1 to ``max_code``."""

    shift: int
    max_step: int
    max_code: int


_MAX_CODE = {name: int(encode_response(np.array(value))) for name, value in MAX_THRESHOLD.items()}
STEPS = {
    "harris": Steps(shift=1, max_step=512, max_code=_MAX_CODE["harris"]),
    "fast": Steps(shift=7, max_step=8, max_code=_MAX_CODE["fast"]),
}
"""Steps by detector; ``max_code`` belongs to the largest threshold that a configuration may have."""


def next_code(code: int, count: int, target: int, detector: str = "harris") -> int:
    """Threshold of the next frame.

    Parameters
    ----------
    code : int
        Threshold of this frame as a response code.
    count : int
        Features of this frame, limited to ``max_features``.
    target : int
        Desired number of features. It must be below ``max_features``, otherwise the threshold would not rise after a
        frame with too many features.
    detector : {"harris", "fast"}

    Returns
    -------
    int
        A response code, 1 to ``STEPS[detector].max_code``.
    """
    steps = STEPS[detector]
    # The shift rounds down: one feature too few lowers the threshold, one too many does not raise it yet.
    step = min(max((count - target) >> steps.shift, -steps.max_step), steps.max_step)
    return min(max(code + step, 1), steps.max_code)
