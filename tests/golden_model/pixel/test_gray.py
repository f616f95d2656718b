"""Gray equals its definition."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from golden_model.pixel.gray import to_gray

sides = st.integers(2, 41)


def noise(*shape: int) -> NDArray[np.uint8]:
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


@pytest.mark.parametrize(
    ("bgr", "gray"), [((255, 0, 0), 29), ((0, 255, 0), 149), ((0, 0, 255), 77), ((255, 255, 255), 255), ((0, 0, 0), 0)]
)
def test_gray_of_pure_colours(bgr: tuple[int, int, int], gray: int) -> None:
    assert to_gray(np.array([[bgr]], np.uint8)) == gray


def test_gray_image_passes_unchanged() -> None:
    image = np.arange(256, dtype=np.uint8).reshape(16, 16)
    np.testing.assert_array_equal(to_gray(image), image)


@pytest.mark.parametrize(("shape", "dtype"), [((8, 8), np.uint16), ((8, 8, 4), np.uint8), ((8,), np.uint8)])
def test_gray_names_what_it_cannot_take(shape: tuple[Any, ...], dtype: type[np.uint16] | type[np.uint8]) -> None:
    with pytest.raises(ValueError, match=rf"{np.dtype(dtype)} of shape .*give uint8 of shape"):
        to_gray(np.zeros(shape, dtype))
