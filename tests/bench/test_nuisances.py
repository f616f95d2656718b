"""Pictures whose pixels a nuisance moves are judged by where it moves them."""

from functools import partial

import numpy as np
import pytest

from bench.nuisances import IMAGES, SEED, SIZE_PX, neighbour_errors_px, steady_turn, vibration
from golden_model.arrays import Matrix
from sim.scene import make_lawnmower

FLIGHT = make_lawnmower(SEED, IMAGES, SIZE_PX)


def shear(number: int, shear_px: float) -> Matrix:
    """Rendered pixels to those of the picture whose lines are shifted to the left, as a camera's steady turn does."""
    middle, rate = np.sin(1.7 * number) * shear_px * np.array([-0.5, 1 / SIZE_PX[1]])
    return np.array([[1, -rate, -middle], [0, 1, 0], [0, 0, 1]])


def inverted(matrix: Matrix) -> Matrix:
    return np.asarray(np.linalg.inv(matrix), np.float64)


@pytest.mark.parametrize("shear_px", [0.0, 6.0])
def test_a_shear_is_undone_by_a_homography(shear_px: float) -> None:
    to_mosaic = {n: inverted(shear(n, shear_px) @ rendered) for n, rendered in enumerate(FLIGHT.homographies)}
    errors = neighbour_errors_px(FLIGHT, to_mosaic, partial(steady_turn, shear_px=shear_px))
    assert len(errors) > IMAGES / 2
    assert max(errors) < 1e-6


def test_a_vibration_is_not() -> None:
    to_mosaic = {n: inverted(rendered) for n, rendered in enumerate(FLIGHT.homographies)}
    errors = neighbour_errors_px(FLIGHT, to_mosaic, partial(vibration, amplitude_px=3))
    assert 1 < np.median(errors) < max(errors) < 6
