"""Columns of gradients, or of pixels for FAST, equal the golden model."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import DETECTORS
from golden_model.formats import GRADIENT
from hdl.pixel.gradients import GradientColumns
from hdl.pixel.harris import TENSOR_LINES
from sim.benches.drivers import Beats
from tests.hdl.pixel.columns import columns, gradients

WIDTH_PX = 24


@pytest.mark.parametrize(
    ("smoothed", "detector", "pixels_per_clock"),
    [(False, "harris", 1), (True, "harris", 2), (True, "fast", 1), (False, "fast", 2)],
)
def test_gradient_columns_equal_the_golden_model(
    gray_frames: list[NDArray[np.uint8]],
    run_block: Callable[..., list[Beats]],
    smoothed: bool,
    detector: str,
    pixels_per_clock: int,
) -> None:
    dut = GradientColumns(smoothed=smoothed, width_px=WIDTH_PX, pixels_per_clock=pixels_per_clock)
    frames = [gray_frames[0], gray_frames[-1]]
    sent = [{"column": columns(frame, 3)} for frame in frames]
    parts = run_block(dut, sent, {"i_fast": DETECTORS.index(detector)})
    for part, frame in zip(parts, frames, strict=True):
        if detector == "fast":
            field, lag_px, expected = "pixels", dut.pixel_lag_px, columns(frame, dut.pixel_lines)
        else:
            field, lag_px = "gradients", dut.gradient_lag_px
            x, y = (plane.astype(int) & (1 << GRADIENT.bits) - 1 for plane in gradients(frame, smoothed))
            expected = columns(x | y << GRADIENT.bits, TENSOR_LINES)
        plane_values = part.plane(field, frame.shape, lag_px=lag_px)
        inside = (slice(7, len(frame) - lag_px - 1), slice(2, frame.shape[1] - lag_px - 1))
        np.testing.assert_array_equal(plane_values[inside], expected[inside])


@pytest.mark.usefixtures("unused_blocks")
def test_smoothed_and_passed_pixels_of_different_lags_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdl.pixel.gradients.PASSED_LAG_PX", 2)
    with pytest.raises(ValueError, match=r"lag_px of the gray .* smoothed has 1, passed has 2"):
        GradientColumns(smoothed=True, width_px=WIDTH_PX)
