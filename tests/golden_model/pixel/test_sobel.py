"""Gradients equal cv2.Sobel, exactly inside the margin."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from golden_model.formats import GRADIENT
from golden_model.pixel.sobel import gradients


def inside(plane: NDArray[Any]) -> NDArray[Any]:
    return plane[1:-1, 1:-1]


@given(data=st.data())
def test_gradients_are_cv2_sobel(contents: Callable[..., Any], data: st.DataObject) -> None:
    gray = data.draw(contents(8, 70))
    gradient_x, gradient_y = gradients(gray)
    np.testing.assert_array_equal(inside(gradient_x), inside(cv2.Sobel(gray, cv2.CV_16S, 1, 0)))
    np.testing.assert_array_equal(inside(gradient_y), inside(cv2.Sobel(gray, cv2.CV_16S, 0, 1)))


def test_gradient_reaches_its_bound_and_points_to_the_bright_side() -> None:
    step = np.zeros((9, 9), np.uint8)
    step[:, 5:] = 255
    for image, axis in ((step, 0), (step.T, 1)):
        along, across = gradients(np.ascontiguousarray(image))[axis], gradients(np.ascontiguousarray(image))[1 - axis]
        assert along.max() == 4 * 255
        assert not across.any()
        assert GRADIENT.holds(along)
        assert GRADIENT.holds(-along)
