from typing import Any

import numpy as np
from numpy.typing import NDArray

from skymosaic.geometry.homography import apply
from skymosaic.geometry.uncertainty import assess_fit

SIZE = (640, 480)
TRUTH = np.array([[0.98, -0.05, 20], [0.04, 1.01, -15], [1e-5, -2e-5, 1]])


def points(
    count: int, rng: np.random.Generator, low: Any = (0, 0), high: tuple[int, int] = SIZE
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    left = rng.uniform(low, high, (count, 2))
    return left, apply(TRUTH, left)


def test_flat_ground_is_told_from_relief_and_from_a_corner() -> None:
    rng = np.random.default_rng(2)
    left, right = points(300, rng)
    right = right + rng.normal(0, 0.3, right.shape)
    flat = assess_fit(TRUTH, left, right, SIZE, SIZE)
    raised = right + np.where(rng.uniform(size=(300, 1)) < 0.5, [[5.0, 0]], 0)
    relief = assess_fit(TRUTH, left, raised, SIZE, SIZE)
    corner_left, corner_right = points(60, rng, high=(160, 120))
    corner = assess_fit(TRUTH, corner_left, corner_right + rng.normal(0, 0.3, (60, 2)), SIZE, SIZE)
    assert flat.held_out_share > 0.95
    assert relief.held_out_share < 0.8
    assert relief.held_out_px > flat.held_out_px
    assert corner.hull_share < 0.1
    assert corner.instability_px > 3 * flat.instability_px


def test_few_matches_give_the_worst_values_and_no_error() -> None:
    left, right = points(4, np.random.default_rng(3))
    quality = assess_fit(TRUTH, left, right, SIZE, SIZE)
    assert quality.held_out_share == 0
    assert quality.instability_px == 12


def test_beyond_a_horizon_in_the_image_nothing_is_measured() -> None:
    tilted = np.array([[1.0, 0, 0], [0, 1, 0], [0, -1 / 300, 1]])
    rng = np.random.default_rng(0)
    left = rng.uniform((0, 0), (640, 200), (60, 2))
    quality = assess_fit(tilted, left, apply(tilted, left) + rng.normal(0, 0.3, left.shape), SIZE, SIZE)
    # The right image shows 640 x 480 px of ground as far as row 185 of the left one, where it is half as large.
    assert quality.hull_share > 0.9
    assert quality.held_out_share == 1
    assert 0 < quality.instability_px < 1
