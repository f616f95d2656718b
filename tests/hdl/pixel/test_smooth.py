# amaranth: UnusedElaboratable=no
"""Binomial smoothing equals the golden model."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.pixel import smooth
from hdl.pixel.smooth import Binomial
from tests.hdl.pixel.columns import columns


@pytest.mark.parametrize(("window_px", "pixels_per_clock"), [(1, 2), (3, 1), (3, 2), (5, 1)])
def test_binomial_equals_the_golden_model(
    gray_frames: list[NDArray[np.uint8]],
    check_block: Callable[..., None],
    window_px: int,
    pixels_per_clock: int,
) -> None:
    frames = [{"column": columns(frame, window_px)} for frame in gray_frames]
    smoothed = [frame if window_px == 1 else smooth.binomial(frame, window_px) for frame in gray_frames]
    expected = {"pixel": smoothed}
    dut = Binomial(window_px=window_px, pixels_per_clock=pixels_per_clock)
    check_block(dut, frames, expected, margin_px=window_px - 1)
