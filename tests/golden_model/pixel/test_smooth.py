"""Binomial smoothing equals integer correlation (SciPy), exactly inside the margin."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import correlate

from golden_model.pixel.smooth import binomial


def inside(plane: NDArray[Any], margin_px: int) -> NDArray[Any]:
    return plane[margin_px:-margin_px, margin_px:-margin_px]


@pytest.mark.parametrize("taps", [[1, 2, 1], [1, 4, 6, 4, 1]])
@given(data=st.data())
def test_smoothing_rounds_the_binomial_sum_once(
    contents: Callable[..., Any], taps: list[int], data: st.DataObject
) -> None:
    gray = data.draw(contents(8, 70))
    kernel = np.outer(taps, taps)
    sums = correlate(gray.astype(np.int64), kernel)
    expected = (sums + kernel.sum() // 2) // kernel.sum()
    np.testing.assert_array_equal(inside(binomial(gray, len(taps)), len(taps) // 2), inside(expected, len(taps) // 2))
