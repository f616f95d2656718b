# amaranth: UnusedElaboratable=no
"""The gain equals the golden model: near and far matches, ties, and elements at both ends of their range."""

import numpy as np

from golden_model.geometry.match_gain import gain
from hdl.blocks.vectors import Block, of_stream
from hdl.geometry.match_gain import PAIR, MatchGain
from tests.hdl.geometry.match_cases import extreme_hypotheses, extreme_matches, matches, near_truth
from tests.hdl.rows import Clocked, row_test


def gains() -> Block:
    """Another hypothesis and another match in every clock."""
    (left, right, _), some = extreme_matches(), matches(30)
    pairs = np.hstack((np.vstack((left, some[0])), np.vstack((right, some[1]))))
    hypotheses = np.concatenate((extreme_hypotheses(), near_truth(12)))
    every = np.indices((len(hypotheses), len(pairs))).reshape(2, -1)
    h, n = every[:, np.random.default_rng(4).permutation(every.shape[1])[:500]]
    found = gain(hypotheses, pairs[:, :2], pairs[:, 2:])[h, n].tolist()
    assert len(set(found)) > 15
    sent = [
        {"hypothesis": each, "match": dict(zip(PAIR.members, pair, strict=True))}
        for each, pair in zip(hypotheses[h].reshape(-1, 9).tolist(), pairs[n].tolist(), strict=True)
    ]
    return of_stream(Clocked(MatchGain()), "", sent, [{"gain": each} for each in found])


test_rows = row_test({"gains": gains})
