# amaranth: UnusedElaboratable=no
"""Counts of many lanes against NumPy's sums."""

import numpy as np
import pytest

from hdl.lib.popcount import Popcount
from tests.hdl.drivers import run_clocks


@pytest.mark.parametrize(("bits", "lanes"), [(3, 2), (8, 3), (24, 2), (256, 1)])
def test_popcount_counts_the_ones_of_each_lane(bits: int, lanes: int) -> None:
    dut = Popcount(bits=bits, lanes=lanes)
    rng = np.random.default_rng(bits)
    inputs = rng.random((25, bits, lanes)) < rng.random((25, 1, lanes))
    inputs[0], inputs[1] = 0, 1
    valid = rng.random(25) < 0.7
    valid[:2] = True
    values = (inputs << np.arange(lanes)).sum(axis=2).tolist()
    rows = [
        [(dut.i_valid, bool(is_valid)), *zip(dut.i_planes, planes, strict=True)]
        for is_valid, planes in zip(valid, values, strict=True)
    ]
    rows += [[]] * dut.latency_cycles  # the last planes stay at the inputs
    counts = run_clocks(dut, rows, dut.o_counts)[dut.latency_cycles :]
    # A count stays until the next valid input.
    last_valid = np.maximum.accumulate(np.where(valid, np.arange(25), 0))
    np.testing.assert_array_equal(counts, inputs.sum(axis=1)[last_valid])


def test_popcount_refuses_too_few_bits() -> None:
    with pytest.raises(ValueError, match="bits is 2"):
        Popcount(bits=2, lanes=1)
