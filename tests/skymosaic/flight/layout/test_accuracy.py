"""Errors of matches that a layout did not use, each of a size that is chosen."""

import numpy as np

from skymosaic.flight.layout.accuracy import Errors, measure_accuracy
from skymosaic.flight.linking.links import Link

NOTHING = np.zeros((0, 2))


def off(left: int, right: int, *errors_px: float) -> Link:
    """A link whose checks are so far off."""
    here = np.arange(2.0 * len(errors_px)).reshape(-1, 2)
    there = here + np.array(errors_px)[:, None] * [0.6, 0.8]
    return Link(left, right, NOTHING, NOTHING, 0, 0, left_checks=here, right_checks=there)


def test_photographs_and_pairs_are_named_the_worst_first_and_of_enough_matches() -> None:
    links = [off(0, 1, *[1] * 5), off(1, 2, *[7] * 4), off(2, 3, 2, 3, 4, 5, 6), Link(0, 3, NOTHING, NOTHING, 0, 0)]
    found = measure_accuracy({view: np.eye(3) for view in range(4)}, links)
    assert found is not None
    rounded = [
        (key, each.matches, round(each.median_px, 9))
        for errors in (found.photographs, found.pairs)
        for key, each in errors.items()
    ]
    assert rounded == [(2, 9, 6), (3, 5, 4), (1, 9, 1), (0, 5, 1), ((2, 3), 5, 4), ((0, 1), 5, 1)]
    assert (found.whole.matches, round(found.whole.median_px, 9), round(found.whole.ninety_px, 9)) == (14, 3.5, 7)
    assert measure_accuracy({}, links[3:]) is None
    moved = np.array([[1.0, 0, 0], [0, 1, -3], [0, 0, 1]])
    only = measure_accuracy({0: moved, 1: np.eye(3)}, [off(0, 1, *[0] * 5)])
    assert only is not None
    assert only.whole == Errors(5, 3.0, 3.0)
