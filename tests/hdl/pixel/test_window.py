# amaranth: UnusedElaboratable=no
"""Line memories and windows give the pixels around each pixel."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from hdl.pixel.window import LineBuffer, OffsetColumns, Window
from sim.benches.drivers import Beats
from tests.hdl.pixel.columns import columns

WIDTH_PX = 24


def test_line_buffer_gives_the_column_above(
    gray_frames: list[NDArray[np.uint8]], run_block: Callable[..., list[Beats]], rate: dict[str, int]
) -> None:
    dut = LineBuffer(shape=8, lines=3, width_px=WIDTH_PX, **rate)
    parts = run_block(dut, [{"pixel": frame} for frame in gray_frames])
    for part, frame in zip(parts, gray_frames, strict=True):
        np.testing.assert_array_equal(part.plane("column", frame.shape)[3:], columns(frame, 4)[3:])


def test_window_gives_the_columns_to_the_left(
    gray_frames: list[NDArray[np.uint8]], run_block: Callable[..., list[Beats]]
) -> None:
    parts = run_block(Window(shape=8, columns=4), [{"column": frame} for frame in gray_frames])
    for part, frame in zip(parts, gray_frames, strict=True):
        window = part.plane("columns", frame.shape)
        for n in range(4):
            np.testing.assert_array_equal(window[:, 3:, n], frame[:, 3 - n : frame.shape[1] - n])


@pytest.mark.parametrize("distance_px", [0, 3])
def test_offset_columns_gives_columns_from_further_up_and_left(
    gray_frames: list[NDArray[np.uint8]], run_block: Callable[..., list[Beats]], distance_px: int, rate: dict[str, int]
) -> None:
    dut = OffsetColumns(rows=2, distance_px=distance_px, **rate)
    parts = run_block(dut, [{"column": columns(frame, distance_px + 2)} for frame in gray_frames])
    for part, frame in zip(parts, gray_frames, strict=True):
        moved = part.plane("column", frame.shape, lag_px=distance_px)
        inside = (slice(1, len(frame) - distance_px), slice(frame.shape[1] - distance_px))
        np.testing.assert_array_equal(moved[inside], columns(frame, 2)[inside])


@pytest.mark.parametrize(
    ("block", "parameters", "message"),
    [
        (LineBuffer, {"shape": 8, "lines": 0, "width_px": 64}, "lines is 0"),
        (LineBuffer, {"shape": 8, "lines": 1, "width_px": 3}, "width_px is 3"),
        (Window, {"shape": 8, "columns": 0}, "columns is 0"),
    ],
)
def test_impossible_parameters_are_named(
    block: type[LineBuffer] | type[Window], parameters: dict[str, int], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        block(**parameters)
