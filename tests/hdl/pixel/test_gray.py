"""Luma and pass-through equal the golden model."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.pixel import gray
from hdl.pixel.gray import Gray


@pytest.mark.parametrize("gray_input", [0, 1])
def test_gray_equals_the_golden_model(
    gray_frames: list[NDArray[np.uint8]], check_block: Callable[..., None], gray_input: int, rate: dict[str, int]
) -> None:
    blue, green, red = gray_frames, gray_frames[1:] + gray_frames[:1], gray_frames[2:] + gray_frames[:2]
    colour = [np.stack(channels, axis=-1) for channels in zip(blue, green, red, strict=True)]
    frames = [{"data": frame.astype(int) @ (1 << 8, 1, 1 << 16)} for frame in colour]
    expected = green if gray_input else [gray.to_gray(frame) for frame in colour]
    check_block(Gray(**rate), frames, {"pixel": expected}, settings={"i_gray_input": gray_input})
