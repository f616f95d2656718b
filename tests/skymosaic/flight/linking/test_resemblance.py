import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import preset_config
from golden_model.feature.orientation import SECTORS
from golden_model.front_end import extract
from golden_model.matching.hamming import distances, mutual_matches
from skymosaic.flight.linking.resemblance import (
    CLOSE_BITS,
    COMPACT_FEATURES,
    PARTNERS,
    compact,
    count_votes,
    likely_pairs,
)

VIEWS, SHARED, WRONG_BITS = 100, 24, 0.1
DESCRIPTOR = np.dtype([("descriptor", np.uint8, 16)])


def test_votes_count_as_the_matcher_would() -> None:
    grain = np.random.default_rng(3).integers(0, 256, (240, 400), dtype=np.uint8)
    ground = cv2.normalize(cv2.GaussianBlur(grain, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)
    config = preset_config("aerial").front_end
    one, other = (compact(extract(view, config).features) for view in (ground[:, :320], ground[:, 80:]))
    bits = 8 * one["descriptor"].shape[1]
    left, right, best, _ = mutual_matches(distances(one["descriptor"], other["descriptor"]), bits)
    close = best <= CLOSE_BITS * bits
    turn = (other["sector"][right[close]] - one["sector"][left[close]]) % SECTORS
    counts = np.bincount(turn, minlength=SECTORS)
    assert count_votes(one, [other, other[:0]]) == [
        max((counts + np.roll(counts, 1) + np.roll(counts, -1)).tolist()),
        0,
    ]
    assert count_votes(one, [other])[0] > 50
    assert count_votes(one, [other])[0] == pytest.approx(count_votes(other, [one])[0], abs=2)


def ring(rng: np.random.Generator) -> list[NDArray[np.void]]:
    """Views of which each shares some of its features, seen a little differently, with the next one."""
    bits = rng.integers(0, 2, (VIEWS, COMPACT_FEATURES, 128), dtype=np.uint8)
    bits[:, :SHARED] = np.roll(bits, 1, axis=0)[:, SHARED : 2 * SHARED] ^ (
        rng.random((VIEWS, SHARED, 128)) < WRONG_BITS
    )
    # Words that every view has, as of flat ground, must not count.
    bits[:, -50:] = bits[0, -50:]
    views = np.zeros((VIEWS, COMPACT_FEATURES), DESCRIPTOR)
    views["descriptor"] = np.packbits(bits, axis=2)
    return list(views)


def test_views_that_share_features_are_likely_pairs() -> None:
    pairs = likely_pairs(ring(np.random.default_rng(5)))
    neighbours = {(view, view + 1) for view in range(VIEWS - 1)} | {(0, VIEWS - 1)}
    assert neighbours <= set(pairs)
    assert pairs == sorted(set(pairs))
    assert all(left < right for left, right in pairs)
    assert len(pairs) <= VIEWS * PARTNERS


def test_few_views_are_all_compared() -> None:
    views = ring(np.random.default_rng(6))[: PARTNERS + 1]
    assert likely_pairs(views) == [(i, j) for i in range(PARTNERS + 1) for j in range(i + 1, PARTNERS + 1)]
    assert likely_pairs([views[0], views[1][:0]]) == [(0, 1)]
    assert likely_pairs([views[0][:0], views[1][:0]]) == [(0, 1)]
    assert likely_pairs(views[:1]) == []
