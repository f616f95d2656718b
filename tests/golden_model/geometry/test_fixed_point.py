"""Homographies are scaled to their largest element, and what has no scale is refused."""

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.geometry.fixed_point import quantise

IDENTITY = np.eye(3)
SHIFTED = np.array([[1.0, 0, 40], [0, 1, 25], [0, 0, 1]])


def test_a_homography_is_scaled_to_its_largest_element() -> None:
    result = quantise(np.stack((SHIFTED, 1e-300 * SHIFTED, -SHIFTED)))
    np.testing.assert_array_equal(result[0], result[1])
    assert np.abs(result).max(axis=(1, 2)).tolist() == [2**24 - 1] * 3
    # Half of an element rounds up, also where it is negative.
    assert result[0, 0, 2] == np.floor(40 / 4096 * (2**24 - 1) + 0.5)
    assert result[2, 0, 2] == np.floor(-40 / 4096 * (2**24 - 1) + 0.5)


@pytest.mark.parametrize(
    ("homographies", "message"),
    [
        (np.eye(3), "shape"),
        (np.ones((1, 3, 4)), "shape"),
        (np.stack((IDENTITY, np.zeros((3, 3)))), "homography 1 is zero or not finite"),
        (np.full((1, 3, 3), np.nan), "homography 0"),
        (np.stack((IDENTITY, IDENTITY, np.full((3, 3), np.inf))), "homography 2"),
    ],
)
def test_what_cannot_be_quantised_is_refused(homographies: NDArray[np.float64], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        quantise(homographies)
