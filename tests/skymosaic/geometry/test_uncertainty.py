import dataclasses
from typing import Any

import numpy as np
import pytest
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


@pytest.mark.parametrize(
    ("count", "homography", "expected"),
    [
        (7, TRUTH, (0, 12, 0.26095, 7)),
        (8, TRUTH, (1 / 3, 2.07568, 0.37123, 8)),
        (40, TRUTH, (1, 1.27130, 0.75254, 39)),
        (60, TRUTH @ np.diag([1, 1, 1000]), (0, 12, 0, 0)),
    ],
    ids=["few", "enough", "many", "no overlap"],
)
def test_a_fit_is_measured(count: int, homography: NDArray[np.float64], expected: tuple[float, ...]) -> None:
    """Few matches, and an overlap that is none, give the worst values and no error."""
    rng = np.random.default_rng(3)
    left, right = points(count, rng)
    quality = assess_fit(homography, left, right + rng.normal(0, 0.5, left.shape), SIZE, SIZE)
    assert dataclasses.astuple(quality) == pytest.approx(expected, rel=1e-3)


def test_beyond_a_horizon_in_the_image_nothing_is_measured() -> None:
    tilted = np.array([[1.0, 0, 0], [0, 1, 0], [0, -1 / 300, 1]])
    rng = np.random.default_rng(0)
    left = rng.uniform((0, 0), (640, 200), (60, 2))
    quality = assess_fit(tilted, left, apply(tilted, left) + rng.normal(0, 0.3, left.shape), SIZE, SIZE)
    # The right image shows 640 x 480 px of ground as far as row 185 of the left one, where it is half as large.
    assert quality.hull_share > 0.9
    assert quality.held_out_share == 1
