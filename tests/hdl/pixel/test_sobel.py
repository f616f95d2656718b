"""Sobel gradients equal the golden model."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from golden_model.pixel import sobel
from hdl.pixel.sobel import Sobel
from tests.hdl.pixel.columns import columns


def test_sobel_equals_the_golden_model(
    gray_frames: list[NDArray[np.uint8]], check_block: Callable[..., None], rate: dict[str, int]
) -> None:
    planes = zip(*map(sobel.gradients, gray_frames), strict=True)
    expected = dict(zip(("gradient_x", "gradient_y"), planes, strict=True))
    check_block(Sobel(**rate), [{"column": columns(frame, 3)} for frame in gray_frames], expected, margin_px=2)
