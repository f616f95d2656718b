"""The gain equals the golden model: near and far matches, ties, and elements at both ends of their range."""

import numpy as np

from golden_model.geometry.match_gain import gain
from hdl.geometry.match_gain import PAIR, MatchGain
from tests.hdl.drivers import run_clocks
from tests.hdl.geometry.match_cases import extreme_hypotheses, extreme_matches, matches, near_truth


def test_gains_equal_the_golden_model() -> None:
    """Another hypothesis and another match in every clock."""
    (left, right, _), some = extreme_matches(), matches(30)
    left, right = np.vstack((left, some[0])), np.vstack((right, some[1]))
    hypotheses = np.concatenate((extreme_hypotheses(), near_truth(12)))
    rng = np.random.default_rng(4)
    pairs = np.stack(np.unravel_index(rng.permutation(len(hypotheses) * len(left))[:500], (len(hypotheses), len(left))))
    dut = MatchGain()
    inputs = []
    for h, n in pairs.T:
        positions = dict(zip(PAIR.members, np.hstack((left[n], right[n])).tolist(), strict=True))
        inputs.append([(dut.i_hypothesis, hypotheses[h].ravel().tolist()), (dut.i_match, positions)])
    outputs = run_clocks(dut, [*inputs, *[[]] * dut.latency_cycles], [dut.o_gain])
    gains = np.ravel(outputs[dut.latency_cycles :])
    np.testing.assert_array_equal(gains, gain(hypotheses, left, right)[tuple(pairs)])
    assert len(set(gains)) > 15
