# amaranth: UnusedElaboratable=no
"""Binomial smoothing equals the golden model."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.pixel import smooth
from hdl.pixel.smooth import Binomial
from tests.hdl.pixel.columns import columns


@pytest.mark.parametrize(
    ("window_px", "model"), [(1, lambda frame: frame), (3, smooth.binomial3), (5, smooth.binomial5)]
)
def test_binomial_equals_the_golden_model(
    gray_frames: list[NDArray[np.uint8]],
    check_block: Callable[..., None],
    window_px: int,
    model: Callable[..., Any],
    rate: dict[str, int],
) -> None:
    frames = [{"column": columns(frame, window_px)} for frame in gray_frames]
    expected = {"pixel": [model(frame) for frame in gray_frames]}
    check_block(Binomial(window_px=window_px, **rate), frames, expected, margin_px=window_px - 1)


def test_impossible_parameters_are_named() -> None:
    with pytest.raises(ValueError, match="window_px is 7"):
        Binomial(window_px=7)
