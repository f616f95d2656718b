"""Which photographs of a flight resemble each other, by their strongest features.

Counting the matches of two photographs takes milliseconds, and the number of pairs grows with the square of the number
of photographs. So each is compared with those that share most words with it. A word is the value of 16 randomly chosen
bits of a descriptor (Indyk and Motwani 1998): two features of the same point differ in about a tenth of their bits and
agree in one word out of five, other features in one out of thousands. Words count the more the rarer they are, as in
text retrieval (Sivic and Zisserman 2003).
"""

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from golden_model.arrays import Float32, Records
from golden_model.feature.orientation import SECTORS

COMPACT_FEATURES = 256
"""The strongest features of a view, few enough to compare every view with every other."""
CLOSE_BITS = 0.22
"""Share of differing bits below which two features may be the same point."""
WORD_BITS, WORDS = 16, 16
"""Bits of a word, and words of each feature."""
PARTNERS = 32
"""Photographs that each one is compared with: all four that resemble it most were among them on every flight tried."""
ROWS_AT_ONCE = 256


def compact(features: Records) -> Records:
    """Keep the 256 strongest features of a view."""
    strongest = np.argsort(-features["response"].astype(np.int64), kind="stable")[:COMPACT_FEATURES]
    chosen: Records = features[strongest]
    return chosen


def count_votes(one: Records, others: Sequence[Records]) -> list[int]:
    """Count the close mutual matches of ``one`` with each of ``others`` that agree on a relative orientation."""
    signs = _signs(one)
    return [_count_agreeing(one, other, signs @ _signs(other).T) for other in others]


def _signs(features: Records) -> Float32:
    """The bits of the descriptors as -1 and 1, (F, B): their products are B - 2 times the Hamming distances.

    A matrix product is several times faster than counting bits, and every view is compared with every other.
    """
    return np.unpackbits(features["descriptor"], axis=1).astype(np.float32) * 2 - 1


def _count_agreeing(left: Records, right: Records, likeness: Float32) -> int:
    if likeness.size == 0:
        return 0
    bits = 8 * left["descriptor"].shape[1]
    nearest = likeness.argmax(axis=1)
    # Few are close, so the way back is looked up for these alone: columns are slow to search.
    left_index = np.flatnonzero(likeness[np.arange(len(left)), nearest] >= (1 - 2 * CLOSE_BITS) * bits)
    mutual = likeness[:, nearest[left_index]].argmax(axis=0) == left_index
    left_index = left_index[mutual]
    relative_orientation = (right["sector"][nearest[left_index]] - left["sector"][left_index]) % SECTORS
    # Sectors are 22.5 degrees wide: a turn between two of them spreads its votes over neighbours.
    histogram = np.bincount(relative_orientation, minlength=SECTORS)
    return int((histogram + np.roll(histogram, 1) + np.roll(histogram, -1)).max())


def likely_pairs(compacts: Sequence[Records]) -> list[tuple[int, int]]:
    """Pair each view with the 32 that share most words with it; sorted, the smaller index of a pair first."""
    words = _words(compacts)
    transposed = words.T.tocsr()
    pairs: set[tuple[int, int]] = set()
    for start in range(0, len(compacts), ROWS_AT_ONCE):
        shared = (words[start : start + ROWS_AT_ONCE] @ transposed).toarray()
        rows = np.arange(start, start + len(shared))
        shared[rows - start, rows] = -1  # No view is its own partner.
        likely = np.argsort(-shared, axis=1, kind="stable")[:, : min(PARTNERS, len(compacts) - 1)]
        both = np.sort(np.stack([np.broadcast_to(rows[:, None], likely.shape), likely], axis=-1).reshape(-1, 2), axis=1)
        pairs.update(zip(*both.T.tolist(), strict=True))
    return sorted(pairs)


def _words(compacts: Sequence[Records]) -> sparse.csr_array:
    """The words of each view, (V, words): the logarithm of how rare each of its words is, else 0."""
    bits = 8 * compacts[0]["descriptor"].shape[1]
    # Always the same bits, so that equal flights propose equal pairs.
    rng = np.random.default_rng(0)
    value = np.zeros((bits, WORDS), dtype=np.float32)
    for word in range(WORDS):
        places = rng.permutation(bits)[:WORD_BITS]
        value[places, word] = 2.0 ** np.arange(len(places))
    # A float32 holds the 16 bits of a word exactly, and its matrix products are the fast ones.
    spoken = [np.unpackbits(features["descriptor"], axis=1) @ value for features in compacts]
    number = np.concatenate(spoken).astype(np.int32) + (np.arange(WORDS, dtype=np.int32) << WORD_BITS)
    starts = WORDS * np.cumsum([0, *(len(features) for features in compacts)])
    ones = np.ones(number.size, dtype=np.float32)
    words = sparse.csr_array((ones, number.ravel(), starts), shape=(len(compacts), WORDS << WORD_BITS))
    words.sum_duplicates()
    words.data = np.log(len(compacts) / np.bincount(words.indices)[words.indices]).astype(np.float32)
    return words
