"""The stages on planes of pixels equal their definitions, OpenCV and SciPy, exactly inside the margin."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import correlate

from golden_model.arrays import Pixels
from golden_model.formats import decode_response, encode_response
from golden_model.pixel.gray import to_gray
from golden_model.pixel.half import halve
from golden_model.pixel.nms import suppress
from golden_model.pixel.smooth import binomial
from golden_model.pixel.sobel import gradients
from golden_model.pixel.threshold import STEPS, next_code
from golden_model.pixel.window import box_sum

sides = st.integers(2, 41)


def noise(*shape: int) -> Pixels:
    return np.random.default_rng(shape).integers(0, 256, shape, dtype=np.uint8)


@given(sides, sides)
def test_gray_is_the_rounded_weighted_sum(height: Any, width: Any) -> None:
    image = noise(height, width, 3)
    blue, green, red = np.moveaxis(image.astype(np.int64), 2, 0)
    np.testing.assert_array_equal(to_gray(image), (77 * red + 150 * green + 29 * blue + 128) // 256)


def test_gray_is_within_one_level_of_the_thesis_weights() -> None:
    # 77, 150 and 29 differ from 256 times the weights by 0.456, -0.272 and -0.184: 0.454 levels at most, and rounding.
    image = noise(400, 400, 3)
    exact = image @ np.array([0.114, 0.587, 0.299])
    assert np.abs(to_gray(image) - exact).max() < 0.96


@pytest.mark.parametrize(("shape", "dtype"), [((8, 8), np.uint16), ((8, 8, 4), np.uint8), ((8,), np.uint8)])
def test_gray_names_what_it_cannot_take(shape: tuple[Any, ...], dtype: type[np.uint16] | type[np.uint8]) -> None:
    with pytest.raises(ValueError, match=rf"{np.dtype(dtype)} of shape .*give uint8 of shape"):
        to_gray(np.zeros(shape, dtype))


@given(sides, sides)
def test_half_is_the_mean_of_two_by_two_rounded_half_up(full_height: int, full_width: int) -> None:
    gray = np.random.default_rng((full_height, full_width)).integers(0, 256, (full_height, full_width), dtype=np.uint8)
    height, width = full_height // 2, full_width // 2
    blocks = gray[: 2 * height, : 2 * width].reshape(height, 2, width, 2)
    np.testing.assert_array_equal(halve(gray), np.floor(blocks.mean(axis=(1, 3)) + 0.5))


@pytest.mark.parametrize("window_px", [1, 3, 5, 7])
def test_box_sums_are_exact_in_32_bits(window_px: int) -> None:
    limit = 2**31 // window_px**2 - 1
    plane = np.random.default_rng(window_px).integers(-limit, limit, (11, 14), dtype=np.int32)
    plane[:9, :9] = limit
    plane[:9, 9:] = -limit
    sums = sliding_window_view(plane.astype(np.int64), (window_px, window_px)).sum(axis=(2, 3))
    margin_px = window_px // 2
    inside = box_sum(plane, window_px)[margin_px : 11 - margin_px, margin_px : 14 - margin_px]
    assert inside.dtype == np.int32
    np.testing.assert_array_equal(inside, sums)


def inside(plane: NDArray[Any], margin_px: int) -> NDArray[Any]:
    return plane[margin_px:-margin_px, margin_px:-margin_px]


@pytest.mark.parametrize("taps", [[1, 2, 1], [1, 4, 6, 4, 1]])
@given(data=st.data())
def test_smoothing_rounds_the_binomial_sum_once(
    contents: Callable[..., Any], taps: list[int], data: st.DataObject
) -> None:
    gray = data.draw(contents(8, 70))
    kernel = np.outer(taps, taps)
    sums = correlate(gray.astype(np.int64), kernel)
    expected = (sums + kernel.sum() // 2) // kernel.sum()
    np.testing.assert_array_equal(inside(binomial(gray, len(taps)), len(taps) // 2), inside(expected, len(taps) // 2))


@given(data=st.data())
def test_gradients_are_cv2_sobel(contents: Callable[..., Any], data: st.DataObject) -> None:
    gray = data.draw(contents(8, 70))
    gradient_x, gradient_y = gradients(gray)
    np.testing.assert_array_equal(inside(gradient_x, 1), inside(cv2.Sobel(gray, cv2.CV_16S, 1, 0), 1))
    np.testing.assert_array_equal(inside(gradient_y, 1), inside(cv2.Sobel(gray, cv2.CV_16S, 0, 1), 1))


# Few values, so that ties and plateaus are common.
codes = st.tuples(st.integers(1, 13), st.integers(1, 13)).flatmap(
    lambda shape: arrays(np.uint16, shape, elements=st.sampled_from([0, 0, 1, 2, 3, 32767]))
)


def naive(code: NDArray[np.uint16], radius_px: int, ties: str) -> NDArray[np.uint16]:
    kept = np.zeros_like(code)
    height, width = code.shape
    for y in range(height):
        for x in range(width):
            others = [
                (int(code[v, u]), (v, u))
                for v in range(max(y - radius_px, 0), min(y + radius_px + 1, height))
                for u in range(max(x - radius_px, 0), min(x + radius_px + 1, width))
                if (u, v) != (x, y)
            ]
            beaten = any(value > code[y, x] for value, _ in others)
            tied = [place for value, place in others if value == code[y, x]]
            loses_tie = bool(tied) if ties == "lose" else any(place < (y, x) for place in tied)
            if code[y, x] and not beaten and not loses_tie:
                kept[y, x] = code[y, x]
    return kept


@pytest.mark.parametrize("ties", ["first", "lose"])
@pytest.mark.parametrize("radius_px", [1, 3])
@given(code=codes)
def test_suppression_equals_the_loop(code: Any, radius_px: int, ties: str) -> None:
    np.testing.assert_array_equal(suppress(code, radius_px, ties), naive(code, radius_px, ties))


def test_an_unknown_tie_rule_is_refused() -> None:
    with pytest.raises(ValueError, match="ties is 'last'; valid: first, lose"):
        suppress(np.zeros((4, 4), np.uint16), 1, "last")


@pytest.mark.parametrize(
    ("code", "count", "following"),
    [(5000, 1000, 5000), (5000, 1001, 5000), (5000, 1002, 5001), (5000, 999, 4999), (5000, 2024, 5512),
     (5000, 9000, 5512), (5000, 0, 4500), (3, 0, 1), (21_400, 2000, 21_503)],
)  # fmt: skip
def test_step_is_half_the_excess_within_limits(code: int, count: int, following: int) -> None:
    assert next_code(code, count, 1000) == following


@given(st.sampled_from(["harris", "fast"]), st.integers(1, 254), st.integers(0, 65_535), st.integers(0, 4096))
def test_code_stays_valid_and_moves_towards_the_target(detector: Any, code: Any, count: Any, target: Any) -> None:
    following = next_code(code, count, target, detector)
    assert 1 <= following <= STEPS[detector].max_code
    assert (following - code) * np.sign(count - target) >= 0


def test_a_code_survives_the_way_through_a_configuration() -> None:
    codes = np.arange(1, STEPS["harris"].max_code + 1)
    np.testing.assert_array_equal(encode_response(decode_response(codes)), codes)


@pytest.mark.parametrize(("detector", "start"), [("harris", 2), ("harris", 20_000), ("fast", 5), ("fast", 200)])
def test_count_settles_near_the_target(detector: str, start: int) -> None:
    rng = np.random.default_rng(0)
    codes = rng.normal(11_000, 2500, 6000) if detector == "harris" else rng.exponential(15, 6000)
    code = start
    for _ in range(60):
        count = int((codes >= code).sum())
        code = next_code(code, count, 1000, detector)
    assert abs(count - 1000) <= 150
