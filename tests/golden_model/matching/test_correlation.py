"""Window scores equal the printed equations in floating point; best matches equal an exhaustive search in fractions."""

from fractions import Fraction
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from golden_model.arrays import Pixels
from golden_model.matching import correlation

SIZES_PX = [1, 2, 3, 10, 22, 25, 30, 38]


def window_pairs(size_px: int, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Similar and unrelated windows, and the extremes."""
    rng = np.random.default_rng(size_px)
    left = rng.integers(0, 256, (count, size_px**2), dtype=np.uint8)
    right = np.clip(left + rng.normal(0, rng.uniform(0, 60, (count, 1)), left.shape), 0, 255).astype(np.uint8)
    left[:3], right[:3] = [[0], [255], [255]], [[255], [255], [0]]
    return left, right


@pytest.mark.parametrize("size_px", SIZES_PX)
def test_scores_equal_the_printed_equations(size_px: int) -> None:
    left, right = window_pairs(size_px)
    a, b = left.astype(float), right.astype(float)
    pixels = size_px**2
    assert (
        correlation.sad(left, right) == [cv2.norm(p, q, cv2.NORM_L1) for p, q in zip(left, right, strict=True)]
    ).all()

    deviation = (a - a.mean(axis=1, keepdims=True)) - (b - b.mean(axis=1, keepdims=True))
    np.testing.assert_allclose(
        correlation.zssd(left, right) / pixels, (deviation**2).sum(axis=1), rtol=1e-12, atol=1e-6
    )

    norm = np.sqrt((a**2).sum(axis=1) * (b**2).sum(axis=1))
    value = np.divide((a * b).sum(axis=1), norm, out=np.zeros(len(a)), where=norm > 0)
    error = value - correlation.ncc(left, right) / 256
    # Rounded down; 1e-12 for the floating reference itself.
    assert (error >= -1e-12).all()
    assert (error < 1 / 256).all()


def test_ncc_of_equal_windows_is_exactly_one_and_of_black_zero() -> None:
    for size_px in SIZES_PX:
        window = np.full((1, size_px**2), 255, dtype=np.uint8)
        assert correlation.ncc(window, window).item() == 256
        assert correlation.ncc(window, window // 3).item() == 256
        assert correlation.ncc(window, window * 0).item() == 0


def exhaustive(left: Pixels, right: Pixels, measure: str) -> list[int]:
    best = []
    for a in left.astype(int).tolist():
        scores = []
        for b in right.astype(int).tolist():
            differences = [p - q for p, q in zip(a, b, strict=True)]
            mean = Fraction(sum(differences), len(a))
            product, energy = sum(p * q for p, q in zip(a, b, strict=True)), sum(q * q for q in b)
            scores.append(
                {
                    "sad": sum(map(abs, differences)),
                    "zssd": sum((d - mean) ** 2 for d in differences),
                    "ncc": -Fraction(product**2, energy or 1),
                }[measure]
            )
        best.append(scores.index(min(scores)))
    return best


# Few gray levels and few pixels: ties are common.
@given(
    measure=st.sampled_from(["sad", "zssd", "ncc"]),
    pixels=st.integers(1, 9),
    counts=st.tuples(st.integers(1, 6), st.integers(1, 8)),
    levels=st.sampled_from([2, 4, 256]),
    seed=st.integers(0, 2**32 - 1),
)
def test_best_matches_equal_exhaustive_search(measure: Any, pixels: int, counts: Any, levels: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    left, right = (rng.integers(0, levels, (count, pixels)).astype(np.uint8) for count in counts)
    left_index, right_index = correlation.best_matches(left, right, measure)
    assert left_index.tolist() == list(range(counts[0]))
    assert right_index.tolist() == exhaustive(left, right, measure)


def test_ncc_decides_between_values_that_a_float_cannot_tell_apart() -> None:
    """Two quotients that are equal as float64 (found by search), although the second is larger."""
    pixels = 38 * 38
    left = np.full((1, pixels), 255, dtype=np.uint8)
    candidates = np.full((2, pixels), 120, dtype=np.uint8)
    for window, (brighter, darker) in zip(candidates, ((354, 137), (548, 70)), strict=True):
        window[:brighter] += 1
        window[brighter : brighter + darker] -= 1
    square = [int(255 * window.sum(dtype=np.int64)) ** 2 for window in candidates]
    energy = [int((window.astype(np.int64) ** 2).sum()) for window in candidates]
    assert square[0] / energy[0] == square[1] / energy[1]
    assert Fraction(square[1], energy[1]) > Fraction(square[0], energy[0])
    assert correlation.best_matches(left, candidates, "ncc")[1].tolist() == [1]


@pytest.mark.parametrize("size_px", SIZES_PX)
def test_windows_are_the_neighbourhood(size_px: int) -> None:
    image = np.random.default_rng(9).integers(0, 256, (90, 100), dtype=np.uint8)
    x, y = np.array([19, 50, 81]), np.array([19, 40, 71])
    windows = correlation.windows(image, x, y, size_px)
    assert windows.shape == (3, size_px**2)
    before = size_px // 2
    for n in range(3):
        top, left = y[n] - before, x[n] - before
        assert (windows[n].reshape(size_px, size_px) == image[top : top + size_px, left : left + size_px]).all()


def test_fuzzy_inputs_are_scaled_scores_rounded_down() -> None:
    left, right = window_pairs(3)
    sad, zssd, ncc = correlation.fuzzy_inputs(left, right)
    assert (sad == np.floor(correlation.sad(left, right) / 9 * 16)).all()
    assert (zssd == np.floor(correlation.zssd(left, right) / 81 * 4)).all()
    assert (ncc == correlation.ncc(left, right)).all()


def test_empty_and_wrong_arguments() -> None:
    window = np.zeros((2, 9), dtype=np.uint8)
    assert [part.tolist() for part in correlation.best_matches(window, window[:0], "sad")] == [[], []]
    assert [part.tolist() for part in correlation.best_matches(window[:0], window, "ncc")] == [[], []]
    image = np.zeros((64, 64), dtype=np.uint8)
    here = np.array([30])
    with pytest.raises(ValueError, match="measure is 'mse'; valid: sad, zssd, ncc"):
        correlation.best_matches(image, image, "mse")
    for size_px in (0, 39):
        with pytest.raises(ValueError, match=f"window size is {size_px} px; it must be 1 to 38"):
            correlation.windows(image, here, here, size_px)
    with pytest.raises(ValueError, match="reaches outside the 64x64 image"):
        correlation.windows(image, np.array([46]), here, 38)
