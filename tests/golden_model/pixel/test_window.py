"""Windows against their definition, pixel by pixel."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from golden_model.pixel.window import box_sum


@pytest.mark.parametrize("window_px", [1, 3, 5, 7])
def test_box_sums_are_exact_in_32_bits(window_px: int) -> None:
    limit = 2**31 // window_px**2 - 1
    plane = np.random.default_rng(window_px).integers(-limit, limit, (11, 14), dtype=np.int32)
    plane[:9, :9] = limit
    plane[:9, 9:] = -limit
    sums = sliding_window_view(plane.astype(np.int64), (window_px, window_px)).sum(axis=(2, 3))
    margin_px = window_px // 2
    inside = box_sum(plane, window_px)[margin_px : 11 - margin_px, margin_px : 14 - margin_px]
    assert inside.dtype == np.int32
    np.testing.assert_array_equal(inside, sums)
