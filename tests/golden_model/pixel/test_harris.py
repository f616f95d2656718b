"""Harris equals its definition in exact integers, follows cv2.cornerHarris, and stays within its proven bounds."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.formats import RAW_RESPONSE, RESPONSE_CODE, TENSOR_DIAGONAL, TENSOR_MIXED, TENSOR_TRACE
from golden_model.pixel.harris import raw_response, response_code, structure_tensor
from golden_model.pixel.smooth import binomial
from golden_model.pixel.sobel import gradients

AERIAL = {"smoothed": True, "window_px": 5, "k": (1, 4), "largest_trace": 65_899}
THESIS = {"smoothed": False, "window_px": 3, "k": (5, 7), "largest_trace": 45_720}
SOBEL = np.outer([1, 2, 1], [-1, 0, 1])


def stages(gray: Pixels, preset: dict[str, Any]) -> tuple[Any, ...]:
    gradient_x, gradient_y = gradients(binomial(gray, 3) if preset["smoothed"] else gray)
    tensor = structure_tensor(gradient_x, gradient_y, preset["window_px"])
    return gradient_x, gradient_y, tensor, raw_response(*tensor, *preset["k"])


def inside(plane: NDArray[Any], margin_px: int = 4) -> NDArray[Any]:
    return plane[margin_px:-margin_px, margin_px:-margin_px]


@pytest.mark.parametrize("preset", [AERIAL, THESIS])
@given(data=st.data())
def test_response_equals_the_definition_in_unbounded_integers(
    contents: Callable[..., Any], preset: dict[str, Any], data: st.DataObject
) -> None:
    gray = data.draw(contents(12, 40))
    gradient_x, gradient_y, tensor, raw = stages(gray, preset)
    window_px = preset["window_px"]
    ix, iy = (sliding_window_view(g.astype(object), (window_px, window_px)) for g in (gradient_x, gradient_y))
    a, b, c = ((product.sum(axis=(2, 3))) // 256 for product in (ix * ix, iy * iy, ix * iy))
    numerator, shift = preset["k"]
    expected = a * b - c * c - (numerator * (a + b) ** 2) // 2**shift
    margin_px = window_px // 2
    for plane, reference in zip((*tensor, raw), (a, b, c, expected), strict=True):
        np.testing.assert_array_equal(inside(plane, margin_px), reference.astype(np.int64))
    diagonal_a, diagonal_b, mixed = tensor
    assert TENSOR_DIAGONAL.holds(diagonal_a)
    assert TENSOR_DIAGONAL.holds(diagonal_b)
    assert TENSOR_MIXED.holds(mixed)
    assert (diagonal_a + diagonal_b).max() <= preset["largest_trace"]
    assert raw.max() < 2**30
    assert RESPONSE_CODE.holds(response_code(raw, 1))


def test_response_follows_corner_harris(texture: Callable[..., Any]) -> None:
    gray = texture(240, 320)
    _, _, (a, b, c), raw = stages(gray, AERIAL)
    scale = 1 / (4 * 5 * 255)  # cornerHarris divides gradients by 2**(ksize - 1), blockSize and 255
    reference = cv2.cornerHarris(binomial(gray, 3), blockSize=5, ksize=3, k=1 / 16).astype(np.float64)
    reference /= scale**4 * 256**2
    # The floors of A, B and C move the determinant by less than A + B + 2 |C| + 2 and the penalty by less than
    # (A + B) / 4 + 2; cornerHarris is single precision.
    trace = (a + b).astype(np.float64)
    tolerance = 1.25 * trace + 2 * np.abs(c) + 4 + 1e-6 * trace**2
    assert (np.abs(inside(raw - reference)) <= inside(tolerance)).all()
    ours, theirs = (np.argpartition(-inside(r).ravel(), 500)[:500] for r in (raw, reference))
    assert np.intersect1d(ours, theirs).size >= 495


def largest_gradient(smoothed: bool) -> np.float64:
    """Largest gradient of any image, from the image that is white where the kernel is positive."""
    kernel, rounding = SOBEL.astype(float), 0.0
    if smoothed:
        kernel = np.outer(np.convolve([1, 2, 1], [1, 2, 1]), np.convolve([-1, 0, 1], [1, 2, 1])) / 16
        rounding = 0.5
    turn = np.linspace(0, np.pi / 2, 20_001)[:, None, None]
    directed = np.cos(turn) * kernel + np.sin(turn) * kernel.T
    directed_sobel = np.cos(turn) * SOBEL + np.sin(turn) * SOBEL.T
    reach = 255 * directed.clip(0).sum(axis=(1, 2)) + rounding * np.abs(directed_sobel).sum(axis=(1, 2))
    return reach.max()


@pytest.mark.parametrize("preset", [AERIAL, THESIS])
def test_bounds_follow_from_the_largest_gradient(preset: dict[str, Any]) -> None:
    trace = int(preset["window_px"] ** 2 * largest_gradient(preset["smoothed"]) ** 2 / 256)
    assert trace <= preset["largest_trace"] <= TENSOR_TRACE.max_raw
    assert preset["largest_trace"] // 2 <= TENSOR_MIXED.max_raw
    numerator, shift = preset["k"]
    k = numerator / 2**shift
    assert (0.25 - k) * preset["largest_trace"] ** 2 < min(RAW_RESPONSE.max_raw, 2**30)
    # The determinant of the floored sums is at least -(A + B + 1).
    assert -k * preset["largest_trace"] ** 2 - 2 * preset["largest_trace"] > RAW_RESPONSE.min_raw


@pytest.mark.parametrize(("threshold", "cut"), [(1, 1), (2, 2), (2047, 2047), (2049, 2048), (1_000_003, 999_936)])
def test_threshold_is_cut_like_the_response(threshold: int, cut: int) -> None:
    raw = np.array([[-5, 0, cut - 1, cut, cut + 1, threshold]], np.int32)
    survived = response_code(raw, threshold) > 0
    np.testing.assert_array_equal(survived, [[False, False, False, True, True, True]])
