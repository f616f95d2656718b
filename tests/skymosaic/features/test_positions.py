"""Positions in records, and points that a mask leaves."""

import numpy as np

from golden_model.records import MATCH
from skymosaic.features.positions import MASK_MARGIN_PX, are_on_ground, feature_points, match_points, raw_positions


def test_points_count_that_are_far_enough_from_what_is_masked() -> None:
    visible = np.full((120, 200), 255, np.uint8)
    visible[60, 100] = 0
    assert MASK_MARGIN_PX == 40
    near = [(60, 60), (140, 60), (100, 20), (100, 100), (60.4, 60), (60, 20)]
    far = [(59, 60), (141, 60), (100, 19), (100, 101), (59.4, 60)]
    # The border of the picture is none of the mask; what lies beyond it is judged as its border is.
    far += [(0, 0), (199, 119), (-3, -9), (250, 300)]
    points = np.array([*near, *far], np.float64)
    assert are_on_ground(points, visible).tolist() == [False] * len(near) + [True] * len(far)
    assert are_on_ground(points, None).all()


def test_records_hold_sixteenths_of_pixels() -> None:
    matches = np.zeros(2, MATCH.dtype)
    for number, name in enumerate(("left_x", "left_y", "right_x", "right_y")):
        matches[name] = 8 * number, 16 * number
    left, right = match_points(matches)
    assert (left.tolist(), right.tolist()) == ([[0, 0.5], [0, 1]], [[1, 1.5], [2, 3]])
    features = np.array([(24, 32)], [("x", "<u2"), ("y", "<u2")])
    assert feature_points(features).tolist() == [[1.5, 2]]


def test_positions_are_rounded_half_up_and_stay_in_the_format() -> None:
    points = np.array([[1.0, 1 + 1 / 32], [1 + 1 / 32 - 1e-6, -5], [0, 1e6]])
    assert raw_positions(points).tolist() == [[16, 17], [16, 0], [0, 65535]]
