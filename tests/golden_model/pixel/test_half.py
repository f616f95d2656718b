"""The half level equals its definition."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from golden_model.pixel.half import halve

sides = st.integers(2, 41)


@given(sides, sides)
def test_half_is_the_mean_of_two_by_two_rounded_half_up(full_height: int, full_width: int) -> None:
    gray = np.random.default_rng((full_height, full_width)).integers(0, 256, (full_height, full_width), dtype=np.uint8)
    height, width = full_height // 2, full_width // 2
    blocks = gray[: 2 * height, : 2 * width].reshape(height, 2, width, 2)
    np.testing.assert_array_equal(halve(gray), np.floor(blocks.mean(axis=(1, 3)) + 0.5))
