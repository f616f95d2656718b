# amaranth: UnusedElaboratable=no
"""Parts of the pixel blocks (gray, half, smooth, sobel, fast, harris, nms, corners) at their extremes.

The blocks themselves are rows of the catalogue, which `tests/hdl/blocks/test_catalogue.py` runs.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import DETECTORS
from golden_model.formats import TENSOR_TRACE, encode_response
from golden_model.pixel import fast, harris, smooth, sobel
from hdl.blocks.catalogue import make_block
from hdl.blocks.vectors import Block, sample_frames, scan
from hdl.pixel.fast import WINDOW_PX, Fast
from hdl.pixel.gradients import GradientColumns
from hdl.pixel.gray import Gray
from hdl.pixel.harris import TENSOR_LINES, RawResponse, ResponseCode, StructureTensor
from hdl.pixel.smooth import Binomial
from hdl.pixel.window import LineBuffer, OffsetColumns, Window
from sim.benches.rows import check
from tests.hdl.rows import row_test

Pixels = NDArray[Any]
TWO = {"pixels_per_clock": 2}
UNSMOOTHED = {"smoothed_gradients": False, "tensor_window_px": 3, "suppression_radius_px": 1}


def columns(plane: Pixels, lines: int) -> Pixels:
    """For each pixel, itself and the ``lines - 1`` above it, in this order; pixels above the frame are arbitrary."""
    above = np.pad(plane, ((lines - 1, 0), (0, 0)), mode="reflect")
    return np.stack([above[lines - 1 - n : len(above) - n] for n in range(lines)], axis=-1)


def of_columns(dut: Any, lines: int, answer: Any, margin_px: int = 0, **settings: int) -> Block:
    """A block that gets columns of the sample frames, as line memories give them."""
    frames = sample_frames()
    each = iter(frames)
    sent = [{"column": columns(frame, lines)} for frame in frames]
    return scan(dut, "", sent, lambda column: answer(next(each)), margin_px=margin_px, settings=settings)


def arcs() -> NDArray[np.uint8]:
    """Touching circles with runs of brighter or darker pixels, around centres of any brightness."""
    rng = np.random.default_rng(3)
    tiles = []
    for run in (8, 9, 16):
        for start, rise in ((0, 40), (5, -40), (11, 1), (14, -1), (3, 255), (8, -255)):
            tile = np.full((WINDOW_PX, WINDOW_PX), 128 - rise // 2) + rng.integers(-1, 2, (WINDOW_PX, WINDOW_PX))
            for step in range(run):
                x, y = fast.CIRCLE[(start + step) % len(fast.CIRCLE)]
                tile[fast.MARGIN_PX + y, fast.MARGIN_PX + x] += rise
            tiles.append(tile.clip(0, 255).astype(np.uint8))
    return np.block([tiles[n : n + 6] for n in range(0, len(tiles), 6)])


def fast_of(threshold: int, lag_px: int, pixels_per_clock: int) -> Block:
    """Circles, and all frames with scores from the threshold to the largest."""
    dut = Fast(lag_px=lag_px, pixels_per_clock=pixels_per_clock)
    frames = [arcs(), sample_frames()[0]]
    each = iter(frames)
    sent = [{"column": columns(frame, dut.lines)} for frame in frames]
    settings = {"i_threshold_code": threshold}
    return scan(dut, "", sent, lambda column: {"code": fast.response_code(next(each), threshold)},
        margin_px=lag_px, settings=settings)  # fmt: skip


def gray_input(**rate: int) -> Block:
    frames = [{"data": frame.astype(int) | 0x3300} for frame in sample_frames()]
    settings = {"i_gray_input": 1}
    return scan(Gray(**rate), "", frames, lambda data: {"pixel": data & 255}, settings=settings)


def gradient_columns(detector: str, **rate: int) -> Block:
    """Not smoothed; the rows of corners have the others."""
    dut = GradientColumns(smoothed=False, width_px=31, **rate)
    is_fast = detector == "fast"
    # A block has one lag; here it depends on the detector.
    dut.lag_px = dut.pixel_lag_px if is_fast else dut.gradient_lag_px

    def answer(frame: Pixels) -> dict[str, Pixels]:
        if is_fast:
            return {"pixels": columns(frame, dut.pixel_lines)}
        pairs = np.frompyfunc(lambda x, y: {"x": x, "y": y}, 2, 1)(*sobel.gradients(frame))
        return {"gradients": columns(pairs, TENSOR_LINES)}

    return of_columns(dut, 3, answer, margin_px=8, i_fast=DETECTORS.index(detector))


def tensor() -> Block:
    dut = StructureTensor(window_px=3)
    planes = [sobel.gradients(frame) for frame in sample_frames()]
    each = iter(planes)
    pixels = np.frompyfunc(lambda x, y: {"x": x, "y": y}, 2, 1)
    sent = [{"column": columns(pixels(x, y), TENSOR_LINES)} for x, y in planes]

    def answer(column: Pixels) -> dict[str, Pixels]:
        return dict(zip("abc", harris.structure_tensor(*next(each), 3), strict=True))

    return scan(dut, "", sent, answer, margin_px=2)


def raw_response() -> Block:
    """The extremes of the structure tensor, and much in between."""
    rng = np.random.default_rng(3)
    largest = TENSOR_TRACE.max_raw // 2
    a, b = rng.integers(0, largest + 1, (2, 20, 20), np.int32)
    a[0, :4], b[0, :4] = (0, largest, 0, largest), (0, 0, 1, largest)
    # The mixed sum is never larger than the geometric mean of the other two.
    c = (np.sqrt(a.astype(float) * b) * rng.choice([-1, 1, 0.3], a.shape)).astype(np.int32)
    return raw_responses(1, 4, [(a, b, c)])


def raw_responses(k_numerator: int, k_shift: int, tensors: Sequence[Sequence[Pixels]] = ()) -> Block:
    """Of structure tensors, by default those of the sample frames."""
    dut = RawResponse(k_numerator=k_numerator, k_shift=k_shift)
    tensors = tensors or [
        harris.structure_tensor(*sobel.gradients(smooth.binomial(frame, 3)), 5) for frame in sample_frames()
    ]
    frames = [dict(zip("abc", tensor, strict=True)) for tensor in tensors]
    return scan(dut, "Harris's response.", frames, lambda **abc: {
        "raw": harris.raw_response(**abc, k_numerator=k_numerator, k_shift=k_shift)})  # fmt: skip


def response_code(threshold: int) -> Block:
    rng = np.random.default_rng(5)
    around_powers = [(1 << k) + d for k in range(31) for d in (-1, 0, 1)]
    edges = np.resize([*around_powers, 0, -1, -(1 << 31), (1 << 31) - 1, threshold], (10, 11))
    spread = (2 ** rng.uniform(0, 31, edges.shape)).astype(np.int64)
    frames = [{"raw": np.asarray(raw, np.int32)} for raw in (edges, spread, -spread)]
    settings = {"i_threshold_code": int(encode_response(np.array(threshold)))}
    return scan(ResponseCode(), "", frames, lambda raw: {"code": harris.response_code(raw, threshold)},
        settings=settings)  # fmt: skip


def line_buffer(**rate: int) -> Block:
    frames = [{"pixel": frame} for frame in sample_frames()]
    block = scan(LineBuffer(shape=8, lines=3, width_px=31, **rate), "", frames,
        lambda pixel: {"column": columns(pixel, 4)})  # fmt: skip
    # To the last column; only the first lines have nothing above them.
    for row in block.outputs["o"]:
        for name in list(row) if row["o_y"] < 3 else ():
            row.pop(name) if name.startswith("o_column") else None
    return block


def offset_columns(distance_px: int, **rate: int) -> Block:
    dut = OffsetColumns(rows=2, distance_px=distance_px, **rate)
    dut.lag_px = distance_px
    lines = distance_px + 2
    return of_columns(dut, lines, lambda frame: {"column": columns(frame, 2)}, margin_px=max(distance_px, 1))


def window() -> Block:
    def answer(column: Pixels) -> dict[str, Pixels]:
        return {"columns": np.stack([np.roll(column, n, axis=1) for n in range(4)], axis=-1)}

    frames = [{"column": frame} for frame in sample_frames()]
    return scan(Window(shape=8, columns=4), "", frames, answer, margin_px=3)


test_rows = row_test({
    "gray as it is": gray_input,
    "smooth 5 at two": partial(make_block, "smooth", {"window_px": 5, **TWO}),
    "smooth 1": lambda: of_columns(Binomial(window_px=1, **TWO), 1, lambda frame: {"pixel": frame}),
    "gradients": partial(gradient_columns, "harris"),
    "pixels for fast at two": partial(gradient_columns, "fast", **TWO),
    "tensor": tensor,
    "raw response": raw_response,
    "raw response of 11": partial(raw_responses, 11, 6),
    "raw response of 0": partial(raw_responses, 0, 0),
    "code from 1": partial(response_code, 1),
    "code from 1500": partial(response_code, 1500),
    "code from 70000": partial(response_code, 70_000),
    "fast of 1": partial(fast_of, 1, 3, 1),
    "fast of 20 at two": partial(fast_of, 20, 4, 2),
    "nms 1": partial(make_block, "nms", {"suppression_radius_px": 1}),
    "nms of fast": partial(make_block, "nms", {"detector": "fast"}),
    "nms of fast at two": partial(make_block, "nms", {"detector": "fast", "suppression_radius_px": 1, **TWO}),
    "corners of fast": partial(make_block, "corners", {"detector": "fast", **UNSMOOTHED}),
    "lines": line_buffer,
    "lines at two": partial(line_buffer, **TWO),
    "offset 0": partial(offset_columns, 0),
    "offset 3 at two": partial(offset_columns, 3, **TWO),
    "window": window,
})  # fmt: skip


def test_fast_waits_for_a_larger_window_of_harris(monkeypatch: pytest.MonkeyPatch) -> None:
    """Line memories for a window of 7 px, around a structure tensor of 5."""
    for name, value in {
        "harris.TENSOR_LINES": 7,
        "gradients.TENSOR_LINES": 7,
        "gradients.GradientColumns.pixel_lines": 9,
        "harris.StructureTensor.lag_px": 3,
    }.items():
        monkeypatch.setattr(f"hdl.pixel.{name}", value)
    check(make_block("corners", {"detector": "fast"}))
