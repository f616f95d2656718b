"""Hamming distances between descriptor sets (thesis, equation III-5) and the mutual check (thesis, III.5.2)."""

import cv2
import numpy as np
from numpy.typing import NDArray

_WORD_BYTES = 8
_CHUNK_ROWS = 32
"""Rows per step: few enough that the intermediate words stay in the processor's cache."""


def distances(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Number of bits in which each left descriptor differs from each right descriptor.

    Parameters
    ----------
    left, right : (F1, B), (F2, B) uint8
        Descriptors of B bytes.

    Returns
    -------
    (F1, F2) uint8, or uint16 where 8 B exceeds 255
        ``popcount(left XOR right)``.
    """
    left_words, right_words = _words(left), _words(right)
    result = np.zeros((len(left), len(right)), dtype=np.min_scalar_type(8 * left.shape[1]))
    for start in range(0, len(left), _CHUNK_ROWS):
        rows = slice(start, start + _CHUNK_ROWS)
        for left_word, right_word in zip(left_words, right_words, strict=True):
            result[rows] += np.bitwise_count(left_word[rows, np.newaxis] ^ right_word)
    return result


def mutual_matches(
    distance: NDArray[np.unsignedinteger], bits: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.uint16], NDArray[np.uint16]]:
    """Mutual nearest neighbours, with their distance and their margin to the second best.

    Ties go to the lowest index. The second best of a pair is the smaller of the second best in its row and in its
    column, where only the pair itself is left out: an equal distance elsewhere gives margin 0. Where there is no
    second, ``bits`` is taken.

    Parameters
    ----------
    distance : (F1, F2) unsigned
        Result of `distances`; either side may be empty.
    bits : int
        Length of the descriptors: the largest distance.

    Returns
    -------
    left, right : (M,) intp
        Row and column of each pair, by rising row.
    best, margin : (M,) uint16
        Distance of the pair, and second best minus best.
    """
    if distance.size == 0:
        nothing, zero = np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.uint16)
        return nothing, nothing, zero, zero
    nearest_right = distance.argmin(axis=1)
    # OpenCV transposes in a fraction of the time that NumPy takes to search columns.
    nearest_left = np.asarray(cv2.transpose(distance)).argmin(axis=1)
    # Mutual: the nearest of a left feature's nearest is that feature itself.
    left = np.flatnonzero(nearest_left[nearest_right] == np.arange(len(distance)))
    right = nearest_right[left]
    # Every row and column holds at most one pair, so one copy without the pairs gives the second best of both.
    others = distance.copy()
    others[left, right] = bits
    second = np.minimum(others.min(axis=1)[left], others.min(axis=0)[right]).astype(np.uint16)
    best = distance[left, right].astype(np.uint16)
    return left, right, best, second - best


def _words(descriptors: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """(F, B) bytes, padded with zeros, as (ceil(B / 8), F) words."""
    # Words of 64 bits take an eighth of the operations; padding is equal on both sides and counts nothing.
    padding = -descriptors.shape[1] % _WORD_BYTES
    return np.ascontiguousarray(np.pad(descriptors, ((0, 0), (0, padding))).view(np.uint64).T)
