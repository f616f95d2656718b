# amaranth: UnusedElaboratable=no
"""Structure tensor, response and its code equal the golden model."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.formats import encode_response
from golden_model.pixel import harris
from hdl.pixel.harris import TENSOR_LINES, RawResponse, ResponseCode, StructureTensor
from tests.hdl.pixel.columns import columns, gradients


@pytest.mark.parametrize(("window_px", "smoothed", "pixels_per_clock"), [(3, False, 1), (5, True, 1), (5, False, 2)])
def test_structure_tensor_equals_the_golden_model(
    gray_frames: list[NDArray[np.uint8]],
    check_block: Callable[..., None],
    window_px: int,
    smoothed: bool,
    pixels_per_clock: int,
) -> None:
    planes = [gradients(frame, smoothed) for frame in gray_frames[:2]]
    pixels = np.frompyfunc(lambda x, y: {"x": x, "y": y}, 2, 1)
    frames = [{"column": columns(pixels(x, y), TENSOR_LINES)} for x, y in planes]
    tensors = zip(*(harris.structure_tensor(x, y, window_px) for x, y in planes), strict=True)
    dut = StructureTensor(window_px=window_px, pixels_per_clock=pixels_per_clock)
    margin_px = max(window_px - 1, dut.lag_px)
    check_block(dut, frames, dict(zip("abc", tensors, strict=True)), margin_px=margin_px)


@pytest.mark.parametrize(("k_numerator", "k_shift"), [(1, 4), (11, 6), (0, 0)])
def test_raw_response_equals_the_golden_model(
    gray_frames: list[NDArray[np.uint8]], check_block: Callable[..., None], k_numerator: int, k_shift: int
) -> None:
    tensors = [harris.structure_tensor(*gradients(frame, True), 5) for frame in gray_frames]
    frames = [dict(zip("abc", tensor, strict=True)) for tensor in tensors]
    expected = [harris.raw_response(*tensor, k_numerator, k_shift) for tensor in tensors]
    check_block(RawResponse(k_numerator=k_numerator, k_shift=k_shift), frames, {"raw": expected})


@pytest.mark.parametrize("threshold", [1, 1500, 70_000])
def test_response_code_equals_the_golden_model(check_block: Callable[..., None], threshold: int) -> None:
    rng = np.random.default_rng(5)
    around_powers = [(1 << k) + d for k in range(31) for d in (-1, 0, 1)]
    edges = np.resize([*around_powers, 0, -1, -(1 << 31), (1 << 31) - 1, threshold], (10, 11))
    spread = (2 ** rng.uniform(0, 31, edges.shape)).astype(np.int64)
    raw = [np.asarray(frame, np.int32) for frame in (edges, spread, -spread)]
    expected = [harris.response_code(frame, threshold) for frame in raw]
    settings = {"i_threshold_code": int(encode_response(np.array(threshold)))}
    check_block(ResponseCode(), [{"raw": frame} for frame in raw], {"code": expected}, settings=settings)


def test_impossible_parameters_are_named() -> None:
    with pytest.raises(ValueError, match="window_px is 4"):
        StructureTensor(window_px=4)
