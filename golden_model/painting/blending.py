"""A pixel of the canvas after another frame has been painted on it.

The frame in which a pixel is farther from the border shows it. Where two frames meet, at equal distances from their
borders, one fades into the other. So the canvas needs no sums, and their order hardly matters: where three frames meet,
it changes a pixel by up to 8 levels.
"""

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.formats import round_shift

FADE = 16
"""Difference of weights over which one frame fades into another. In frames of up to 511 lines the middle of the fade is
where both borders are equally far away, and its ends are where one is 8 px farther away than the other."""
FADE_LOG2 = FADE.bit_length() - 1


def blend(
    old: Pixels, colours: NDArray[np.int64], weights: NDArray[np.int64], *, replace: bool = False
) -> NDArray[np.uint8]:
    """Paint pixels of a frame on pixels of the canvas.

    The new colour's share is (w - w' + 8) / 16, limited to 0 and 1, with the weight w in the frame and w' on the
    canvas; all of it where the canvas was never painted, and nothing outside the frame. The larger weight stays.

    Parameters
    ----------
    old : ndarray of uint8, shape (..., 4)
        Blue, green, red and weight on the canvas; weight 0: never painted.
    colours : ndarray of int, shape (..., 3)
    weights : ndarray of int, shape (...)
        Of the frame's pixels (`golden_model.painting.sampling.sample`), 0 outside the frame.
    replace : bool
        Forget the old pixels: outside the frame the canvas becomes 0, as stabilised video needs.

    Returns
    -------
    ndarray of uint8, shape (..., 4)
        The canvas afterwards; halves are rounded up.
    """
    under = np.zeros(old.shape, np.int64) if replace else old.astype(np.int64)
    before = under[..., 3]
    share = np.where(before == 0, FADE, np.clip(weights - before + FADE // 2, 0, FADE))
    share = np.where(weights == 0, 0, share)[..., None]
    mixed = round_shift(under[..., :3] * (FADE - share) + colours * share, FADE_LOG2)
    return np.concatenate([mixed, np.maximum(before, weights)[..., None]], axis=-1).astype(np.uint8)
