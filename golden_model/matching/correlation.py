"""Window correlation (thesis, equations III-1 to III-3) in integers: SAD, ZSSD, NCC and the best match under each.

Windows are uint8 arrays whose last axis runs over the n pixels, in raster order; the other axes broadcast.
"""

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from golden_model.feature.ilbp import gather
from golden_model.formats import UQ

Windows = NDArray[np.uint8]
Scores = NDArray[np.int64]

SAD_PER_PIXEL = UQ(8, 4)
"""SAD in gray levels per pixel, the unit of the fuzzy system."""
ZSSD_PER_PIXEL = UQ(16, 2)
"""ZSSD in squared gray levels per pixel, the unit of the fuzzy system."""
NCC = UQ(1, 8)
"""Normalised correlation: 256 represents 1."""
MAX_WINDOW_PX = 38
"""Largest side of a window: up to here the square of a sum of products is below 2**53 and exact in a float64."""


def windows(gray: NDArray[np.uint8], x: NDArray[np.integer], y: NDArray[np.integer], size_px: int) -> Windows:
    """The square windows around (N,) positions: (N, size_px**2) uint8.

    The centre is pixel ``size_px // 2`` of the window in x and y: the middle of an odd window, the pixel right of
    and below the middle of an even one.

    Raises
    ------
    ValueError
        If the size is not 1 to 38 px, or a window leaves the (H, W) image.
    """
    if not 1 <= size_px <= MAX_WINDOW_PX:
        raise ValueError(f"window size is {size_px} px; it must be 1 to {MAX_WINDOW_PX}")
    steps = range(-(size_px // 2), size_px - size_px // 2)
    return np.ascontiguousarray(gather(gray, x, y, [(dx, dy) for dy in steps for dx in steps]).T)


def sad(left: Windows, right: Windows) -> Scores:
    """Sum of absolute differences (equation III-1); at most 255 n."""
    # The larger minus the smaller never leaves 8 bits, unlike the plain difference.
    total: Scores = (np.maximum(left, right) - np.minimum(left, right)).sum(axis=-1, dtype=np.int64)
    return total


def zssd(left: Windows, right: Windows) -> Scores:
    """The zero-mean sum of squared differences (equation III-2) times n, exactly: n sum(d**2) - sum(d)**2.

    With d = left - right this is n sum((d - mean(d))**2): 0 to (255 n)**2.
    """
    difference = left.astype(np.int64) - right
    pixels = difference.shape[-1]
    scaled: Scores = pixels * (difference**2).sum(axis=-1) - difference.sum(axis=-1) ** 2
    return scaled


def ncc(left: Windows, right: Windows) -> Scores:
    """Normalised cross-correlation (equation III-3), UQ1.8: the exact value rounded down, error below 1/256.

    The value is 0 where a window is entirely black. It is never negative, because pixels are not.
    """
    # Python's integers: the squared product of 38 x 38 px, scaled, exceeds 64 bits.
    product, left_energy, right_energy = (np.asarray(s, dtype=object) for s in _ncc_sums(left, right))
    energy = np.maximum(left_energy * right_energy, 1)
    root = np.frompyfunc(math.isqrt, 1, 1)
    return np.asarray(root((product * NCC.one) ** 2 // energy)).astype(np.int64)


def best_matches(left: Windows, right: Windows, measure: str) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The best right window for every left window: smallest SAD or ZSSD, or largest NCC; ties to the lowest index.

    NCC is compared as (sum I1 I2)**2 / sum(I2**2), without root or rounding; close values are compared as fractions.

    Parameters
    ----------
    left, right : (F1, n), (F2, n) uint8
        Windows of one size.
    measure : {"sad", "zssd", "ncc"}
        The score to compare.

    Returns
    -------
    left_index, right_index : (F1,) intp
        Every left index and its best right index; both empty if there are no right windows.

    Raises
    ------
    ValueError
        For another measure.
    """
    if measure not in _NEAREST:
        raise ValueError(f"measure is {measure!r}; valid: {', '.join(_NEAREST)}")
    if len(right) == 0:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    right_index = np.array([_NEAREST[measure](window, right) for window in left], dtype=np.intp)
    return np.arange(len(left), dtype=np.intp), right_index


def fuzzy_inputs(left: Windows, right: Windows) -> tuple[Scores, Scores, Scores]:
    """Inputs of `golden_model.matching.rule_bases.correlation`: SAD in 1/16, ZSSD in 1/4, NCC in 1/256.

    Table III-1 does not say whether SAD and ZSSD are per pixel or sums over the window. They are per pixel: with sums,
    almost no window would belong to the set of good matches. Each score is rounded down.
    """
    pixels = left.shape[-1]
    return (
        SAD_PER_PIXEL.one * sad(left, right) // pixels,
        ZSSD_PER_PIXEL.one * zssd(left, right) // pixels**2,
        ncc(left, right),
    )


def _ncc_sums(left: Windows, right: Windows) -> tuple[Scores, Scores, Scores]:
    wide_left, wide_right = left.astype(np.int64), right.astype(np.int64)
    return (wide_left * wide_right).sum(axis=-1), (wide_left**2).sum(axis=-1), (wide_right**2).sum(axis=-1)


def _largest_ncc(window: Windows, candidates: Windows) -> int:
    product, _, energy = _ncc_sums(window, candidates)
    square = product**2
    energy = np.maximum(energy, 1)
    # Numerator and denominator are exact in a float64, and rounding the quotient keeps the order: the exact maximum is
    # among the largest quotients, and fractions decide between these.
    quality = square / energy
    closest = np.flatnonzero(quality == quality.max())
    return int(max(closest, key=lambda i: Fraction(int(square[i]), int(energy[i]))))


_NEAREST: dict[str, Callable[[Windows, Windows], int]] = {
    "sad": lambda window, candidates: int(np.argmin(sad(window, candidates))),
    "zssd": lambda window, candidates: int(np.argmin(zssd(window, candidates))),
    "ncc": _largest_ncc,
}
