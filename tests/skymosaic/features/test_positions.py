"""Positions in records, and points that a mask leaves."""

import numpy as np

from skymosaic.features.positions import MASK_MARGIN_PX, are_on_ground, raw_positions


def test_points_count_that_are_far_enough_from_what_is_masked() -> None:
    visible = np.full((120, 160), 255, np.uint8)
    visible[:, 80:] = 0
    visible[0, 0] = 0
    near = 79 - MASK_MARGIN_PX
    points = np.array([[near, 100], [near + 0.4, 100], [near + 1, 100], [41, 0], [40, 0], [0, 41], [0, 40], [200, 99]])
    assert are_on_ground(points, visible).tolist() == [True, True, False, False, False, True, False, False]
    assert are_on_ground(points, None).all()
    # The border of the picture is none of the mask.
    assert are_on_ground(np.array([[0.0, 119], [-3, 130]]), visible).all()


def test_positions_are_rounded_half_up_and_stay_in_the_format() -> None:
    points = np.array([[1.0, 1 + 1 / 32], [1 + 1 / 32 - 1e-6, -5], [0, 1e6]])
    assert raw_positions(points).tolist() == [[16, 17], [16, 0], [0, 65535]]
