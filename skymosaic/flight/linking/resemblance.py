"""Which photographs of a flight resemble each other, by their strongest features.

Counting the matches of two photographs takes milliseconds, and the number of pairs grows with the square of the number
of photographs. So each is compared with those that share most words with it. A word is what a descriptor has at 16 of
its bits: two features of the same point, of whose bits about a tenth differ, agree in a word once in five times, two
others once in thousands. Words that many photographs have tell little and count little, as in text retrieval (Sivic
and Zisserman 2003); the bits of a word are drawn by chance (Indyk and Motwani 1998).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from golden_model.arrays import Float32, Records
from golden_model.feature.orientation import SECTORS

COMPACT_FEATURES = 256
CLOSE_BITS = 0.22
"""Share of differing bits below which two features may be the same point."""
WORD_BITS, WORDS = 16, 16
"""Bits of a word, and words of each feature."""
LIKELY = 32
"""Photographs that each one is compared with: all four that resemble it most were among them on every flight tried."""
ROWS_AT_ONCE = 256


def compact(features: Records) -> Records:
    """The 256 strongest features of a view, few enough to compare every view with every other."""
    strongest = np.argsort(-features["response"].astype(np.int64), kind="stable")[:COMPACT_FEATURES]
    chosen: Records = features[strongest]
    return chosen


def votes(one: Records, others: Sequence[Records]) -> list[int]:
    """Number of close mutual matches that agree on a relative orientation, for ``one`` against each of ``others``."""
    signs = _signs(one)
    return [_agreeing(one, other, signs @ _signs(other).T) for other in others]


def _signs(features: Records) -> Float32:
    """The bits of the descriptors as -1 and 1, (F, B): their products are B - 2 times the Hamming distances.

    A matrix product is several times faster than counting bits, and every view is compared with every other.
    """
    return np.unpackbits(features["descriptor"], axis=1).astype(np.float32) * 2 - 1


def _agreeing(left: Records, right: Records, likeness: Float32) -> int:
    if likeness.size == 0:
        return 0
    bits = 8 * left["descriptor"].shape[1]
    nearest = likeness.argmax(axis=1)
    # Few are close, so the way back is looked up for these alone: columns are slow to search.
    left_index = np.flatnonzero(likeness[np.arange(len(left)), nearest] >= (1 - 2 * CLOSE_BITS) * bits)
    mutual = likeness[:, nearest[left_index]].argmax(axis=0) == left_index
    left_index = left_index[mutual]
    relative_orientation = (right["sector"][nearest[left_index]] - left["sector"][left_index]) % SECTORS
    histogram = np.bincount(relative_orientation, minlength=SECTORS)
    return int((histogram + np.roll(histogram, 1) + np.roll(histogram, -1)).max())


def likely_pairs(compacts: Sequence[Records]) -> list[tuple[int, int]]:
    """Pairs worth comparing: each view with the 32 that share most words with it, the smaller index first, sorted.

    Parameters
    ----------
    compacts : sequence of structured ndarray
        From `compact`.
    """
    words = _words(compacts)
    transposed = words.T.tocsr()
    pairs: set[tuple[int, int]] = set()
    for start in range(0, len(compacts), ROWS_AT_ONCE):
        shared = (words[start : start + ROWS_AT_ONCE] @ transposed).toarray()
        rows = np.arange(start, start + len(shared))
        shared[rows - start, rows] = -1
        likely = np.argsort(-shared, axis=1, kind="stable")[:, : min(LIKELY, len(compacts) - 1)]
        both = np.sort(np.stack([np.broadcast_to(rows[:, None], likely.shape), likely], axis=-1).reshape(-1, 2), axis=1)
        pairs.update(zip(*both.T.tolist(), strict=True))
    return sorted(pairs)


def _words(compacts: Sequence[Records]) -> sparse.csr_array:
    """What each view says, (V, words): how rare each of its words is, as a logarithm."""
    bits = 8 * compacts[0]["descriptor"].shape[1]
    rng = np.random.default_rng(0)
    value = np.zeros((bits, WORDS), dtype=np.float32)
    for word in range(WORDS):
        places = rng.permutation(bits)[:WORD_BITS]
        value[places, word] = 2.0 ** np.arange(len(places))
    spoken = [np.unpackbits(features["descriptor"], axis=1) @ value for features in compacts]
    number = np.concatenate(spoken).astype(np.int32) + (np.arange(WORDS, dtype=np.int32) << WORD_BITS)
    starts = WORDS * np.cumsum([0, *(len(features) for features in compacts)])
    ones = np.ones(number.size, dtype=np.float32)
    said = sparse.csr_array((ones, number.ravel(), starts), shape=(len(compacts), WORDS << WORD_BITS))
    said.sum_duplicates()
    said.data = np.log(len(compacts) / np.bincount(said.indices)[said.indices]).astype(np.float32)
    return said
