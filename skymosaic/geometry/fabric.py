"""The estimator of the hardware on the host: the golden model of `hdl.geometry.estimator`, bit for bit."""

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Matrix, Points
from golden_model.config import EstimatorConfig
from golden_model.formats import POSITION
from golden_model.geometry.estimator import FrameMatches
from golden_model.geometry.estimator import estimate as estimate_in_integers
from golden_model.geometry.fixed_point import homography_elements

UNITS_PX = np.array([1 << POSITION.integer_bits, 1 << POSITION.integer_bits, 1])
"""Units of left and right homogeneous coordinates in the elements of the hardware, px."""


def estimate_as_in_fabric(
    left: Points, right: Points, weight: Array, size: tuple[int, int], *, rng: np.random.Generator
) -> Matrix | None:
    """Estimate a homography as the estimator on the chip does, which also decides whether it is accepted.

    Positions are rounded to 1/16 px and weights, 0 to 255, to integers, as they already are in match records. Matches
    outside the range of positions do not count. ``size`` is that of the right image; ``rng`` gives the seed of the
    samples. None for a homography that is not accepted.
    """
    positions = np.floor(np.hstack((left, right)) * POSITION.one + 0.5).astype(np.int64)
    stored = ((positions >= 0) & (positions <= POSITION.max_raw)).all(axis=1)
    weights = np.rint(weight[stored]).astype(np.int64)
    matches = FrameMatches(positions[stored, :2], positions[stored, 2:], weights, size)
    result = estimate_in_integers(matches, draw_config(rng))
    return None if result.causes else in_pixels(result.homography)


def draw_config(rng: np.random.Generator) -> EstimatorConfig:
    """The estimator's configuration with a seed."""
    return EstimatorConfig(seed=int(rng.integers(1, 1 << 32)))


def homography_in_pixels(record: np.void) -> Matrix | None:
    """Convert a Homography record to a homography of pixels; None where it is not accepted."""
    return None if record["causes"] else in_pixels(homography_elements(record))


def in_pixels(homography: NDArray[np.integer]) -> Matrix:
    """Convert a homography (3, 3) in the integers of the hardware to one of pixels, with 1 as its last element."""
    scaled: Matrix = homography * UNITS_PX[:, np.newaxis] / UNITS_PX
    scaled /= scaled[2, 2]
    return scaled
