# amaranth: UnusedElaboratable=no
"""The blocks that map planes to planes, each compared with its golden model."""

import numpy as np
import pytest

from golden_model.config import DETECTORS
from golden_model.formats import GRADIENT, encode_response
from golden_model.pixel import gray, half, harris, nms, smooth, sobel
from hdl.pixel.fast import WINDOW_PX
from hdl.pixel.gradients import GradientColumns
from hdl.pixel.gray import Gray
from hdl.pixel.half import Half
from hdl.pixel.harris import TENSOR_LINES, RawResponse, ResponseCode, StructureTensor
from hdl.pixel.nms import Suppression
from hdl.pixel.smooth import Binomial
from hdl.pixel.sobel import Sobel
from hdl.pixel.window import LineBuffer, OffsetColumns, Window
from sim.benches.drivers import run_beats
from tests.hdl.pixel.columns import columns

WIDTH_PX = 24


@pytest.fixture(params=[1, 2], ids=["one_pixel", "two_pixels"])
def rate(request):
    """Parameters of a block: pixels of a beat."""
    return {"pixels_per_clock": request.param}


def gradients(frame, smoothed):
    return sobel.gradients(smooth.binomial3(frame) if smoothed else frame)


def test_line_buffer_gives_the_column_above(gray_frames, run_block, rate):
    dut = LineBuffer(shape=8, lines=3, width_px=WIDTH_PX, **rate)
    parts = run_block(dut, [{"pixel": frame} for frame in gray_frames])
    for part, frame in zip(parts, gray_frames, strict=True):
        np.testing.assert_array_equal(part.plane("column", frame.shape)[3:], columns(frame, 4)[3:])


def test_window_gives_the_columns_to_the_left(gray_frames, run_block):
    parts = run_block(Window(shape=8, columns=4), [{"column": frame} for frame in gray_frames])
    for part, frame in zip(parts, gray_frames, strict=True):
        window = part.plane("columns", frame.shape)
        for n in range(4):
            np.testing.assert_array_equal(window[:, 3:, n], frame[:, 3 - n : frame.shape[1] - n])


@pytest.mark.parametrize("distance_px", [0, 3])
def test_offset_columns_gives_columns_from_further_up_and_left(gray_frames, run_block, distance_px, rate):
    dut = OffsetColumns(shape=8, rows=2, distance_px=distance_px, **rate)
    parts = run_block(dut, [{"column": columns(frame, distance_px + 2)} for frame in gray_frames])
    for part, frame in zip(parts, gray_frames, strict=True):
        moved = part.plane("column", frame.shape, lag_px=distance_px)
        inside = (slice(1, len(frame) - distance_px), slice(frame.shape[1] - distance_px))
        np.testing.assert_array_equal(moved[inside], columns(frame, 2)[inside])


@pytest.mark.parametrize("gray_input", [0, 1])
def test_gray_equals_the_golden_model(gray_frames, check_block, gray_input, rate):
    blue, green, red = gray_frames, gray_frames[1:] + gray_frames[:1], gray_frames[2:] + gray_frames[:2]
    colour = [np.stack(channels, axis=-1) for channels in zip(blue, green, red, strict=True)]
    frames = [{"data": frame.astype(int) @ (1 << 8, 1, 1 << 16)} for frame in colour]
    expected = green if gray_input else [gray.to_gray(frame) for frame in colour]
    check_block(Gray(**rate), frames, {"pixel": expected}, settings={"i_gray_input": gray_input})


@pytest.mark.parametrize("shape", [(19, 23), (18, 24), (4, 4)])
def test_half_equals_the_golden_model(gray_frames, pauses, shape, rate):
    dut = Half(width_px=WIDTH_PX, **rate)
    # Two pixels of a beat must both be in the line.
    frames = [
        np.resize(frame, (shape[0], shape[1] // dut.pixels_per_clock * dut.pixels_per_clock)) for frame in gray_frames
    ]
    sent, received = run_beats(dut, [{"pixel": frame} for frame in frames], pauses=pauses, received_per_clock=1)
    ends_block = (sent.fields["x"] % 2 == 1) & (sent.fields["y"] % 2 == 1)
    np.testing.assert_array_equal(received.cycles - sent.cycles[ends_block], dut.latency_cycles)
    for part, frame in zip(received.split(), frames, strict=True):
        expected = half.halve(frame)
        np.testing.assert_array_equal(part.plane("pixel", expected.shape), expected)


@pytest.mark.parametrize(
    ("window_px", "model"), [(1, lambda frame: frame), (3, smooth.binomial3), (5, smooth.binomial5)]
)
def test_binomial_equals_the_golden_model(gray_frames, check_block, window_px, model, rate):
    frames = [{"column": columns(frame, window_px)} for frame in gray_frames]
    expected = {"pixel": [model(frame) for frame in gray_frames]}
    check_block(Binomial(window_px=window_px, **rate), frames, expected, margin_px=window_px - 1)


def test_sobel_equals_the_golden_model(gray_frames, check_block, rate):
    planes = zip(*map(sobel.gradients, gray_frames), strict=True)
    expected = dict(zip(("gradient_x", "gradient_y"), planes, strict=True))
    check_block(Sobel(**rate), [{"column": columns(frame, 3)} for frame in gray_frames], expected, margin_px=2)


@pytest.mark.parametrize(("window_px", "smoothed", "pixels_per_clock"), [(3, False, 1), (5, True, 1), (5, False, 2)])
def test_structure_tensor_equals_the_golden_model(gray_frames, check_block, window_px, smoothed, pixels_per_clock):
    planes = [gradients(frame, smoothed) for frame in gray_frames]
    pixels = np.frompyfunc(lambda x, y: {"x": x, "y": y}, 2, 1)
    frames = [{"column": columns(pixels(x, y), TENSOR_LINES)} for x, y in planes]
    tensors = zip(*(harris.structure_tensor(x, y, window_px) for x, y in planes), strict=True)
    dut = StructureTensor(window_px=window_px, pixels_per_clock=pixels_per_clock)
    check_block(dut, frames, dict(zip("abc", tensors, strict=True)), margin_px=window_px - 1)


@pytest.mark.parametrize("smoothed", [False, True])
@pytest.mark.parametrize("detector", DETECTORS)
def test_gradient_columns_equal_the_golden_model(gray_frames, run_block, smoothed, detector, rate):
    dut = GradientColumns(smoothed=smoothed, width_px=WIDTH_PX, **rate)
    frames = [gray_frames[0], gray_frames[-1]]
    sent = [{"column": columns(frame, 3)} for frame in frames]
    parts = run_block(dut, sent, {"i_fast": DETECTORS.index(detector)})
    for part, frame in zip(parts, frames, strict=True):
        if detector == "fast":
            field, lag_px, expected = "pixels", dut.pixel_lag_px, columns(frame, WINDOW_PX)
        else:
            field, lag_px = "gradients", dut.gradient_lag_px
            x, y = (plane.astype(int) & (1 << GRADIENT.bits) - 1 for plane in gradients(frame, smoothed))
            expected = columns(x | y << GRADIENT.bits, TENSOR_LINES)
        plane_values = part.plane(field, frame.shape, lag_px=lag_px)
        inside = (slice(7, len(frame) - lag_px - 1), slice(2, frame.shape[1] - lag_px - 1))
        np.testing.assert_array_equal(plane_values[inside], expected[inside])


@pytest.mark.parametrize(("k_numerator", "k_shift"), [(1, 4), (5, 7), (11, 6), (0, 0)])
def test_raw_response_equals_the_golden_model(gray_frames, check_block, k_numerator, k_shift):
    tensors = [harris.structure_tensor(*gradients(frame, True), 5) for frame in gray_frames]
    frames = [dict(zip("abc", tensor, strict=True)) for tensor in tensors]
    expected = [harris.raw_response(*tensor, k_numerator, k_shift) for tensor in tensors]
    check_block(RawResponse(k_numerator=k_numerator, k_shift=k_shift), frames, {"raw": expected})


@pytest.mark.parametrize("threshold", [1, 1500, 70_000])
def test_response_code_equals_the_golden_model(check_block, threshold):
    rng = np.random.default_rng(5)
    around_powers = [(1 << k) + d for k in range(31) for d in (-1, 0, 1)]
    edges = np.resize([*around_powers, 0, -1, -(1 << 31), (1 << 31) - 1, threshold], (10, 11))
    spread = (2 ** rng.uniform(0, 31, edges.shape)).astype(np.int64)
    raw = [np.asarray(frame, np.int32) for frame in (edges, spread, -spread)]
    expected = [harris.response_code(frame, threshold) for frame in raw]
    settings = {"i_threshold_code": int(encode_response(np.array(threshold)))}
    check_block(ResponseCode(), [{"raw": frame} for frame in raw], {"code": expected}, settings=settings)


@pytest.mark.parametrize("radius_px", [1, 3])
@pytest.mark.parametrize("detector", DETECTORS)
def test_suppression_equals_the_golden_model(check_block, radius_px, detector, rate):
    rng = np.random.default_rng(6)
    shape = (19, 23)
    twins = np.zeros(shape, int)
    twins[9, [11, 12]] = twins[10, 10] = 9
    is_fast = detector == "fast"
    largest = 255 if is_fast else 1 << 15
    codes = [*(rng.integers(0, high, shape) for high in (2, 6, largest)), np.full(shape, 7), twins]
    rule = (1, "lose") if is_fast else (radius_px, "first")
    survivors = [nms.suppress(frame.astype(np.uint16), *rule) for frame in codes]
    assert sum(map(np.count_nonzero, survivors)) >= 20
    expected = {
        "code": survivors,
        "left": [np.roll(frame, 1, axis=1) for frame in codes],
        "right": [np.roll(frame, -1, axis=1) for frame in codes],
        "up": [np.roll(frame, 1, axis=0) for frame in codes],
        "down": [np.roll(frame, -1, axis=0) for frame in codes],
    }
    # At most one of two neighbours survives, whatever their ties: a beat of two pixels holds one corner.
    assert not any((plane[:, 1:] & plane[:, :-1]).any() for plane in (frame > 0 for frame in survivors))
    dut = Suppression(radius_px=radius_px, width_px=WIDTH_PX, **rate)
    settings = {"i_fast": int(is_fast)}
    check_block(dut, [{"code": frame} for frame in codes], expected, margin_px=radius_px, settings=settings)


@pytest.mark.parametrize(
    ("block", "parameters", "message"),
    [
        (Binomial, {"window_px": 7}, "window_px is 7"),
        (StructureTensor, {"window_px": 4}, "window_px is 4"),
        (Suppression, {"radius_px": 2, "width_px": 64}, "radius_px is 2"),
        (LineBuffer, {"shape": 8, "lines": 0, "width_px": 64}, "lines is 0"),
        (LineBuffer, {"shape": 8, "lines": 1, "width_px": 3}, "width_px is 3"),
        (Window, {"shape": 8, "columns": 0}, "columns is 0"),
    ],
)
def test_impossible_parameters_are_named(block, parameters, message):
    with pytest.raises(ValueError, match=message):
        block(**parameters)
