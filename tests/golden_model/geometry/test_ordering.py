"""The order of matches, against Python's own stable sorting."""

import numpy as np

from golden_model.geometry.ordering import BINS, order


def test_matches_are_ordered_by_falling_weight() -> None:
    assert order(np.array([3, 255, 0, 3, 255])).tolist() == [1, 4, 0, 3, 2]


def test_many_equal_weights_keep_their_order_and_every_weight_has_a_bin() -> None:
    weight = np.random.default_rng(1).integers(0, BINS, 2000)
    assert order(weight.astype(np.uint8)).tolist() == sorted(range(2000), key=lambda n: -weight[n])
    assert np.iinfo(np.uint8).max + 1 == BINS
