"""FAST equals cv2.FastFeatureDetector TYPE_9_16 exactly: the corners at every threshold, and the scores."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.pixel.fast import response_code, score
from golden_model.pixel.nms import suppress


def opencv_corners(gray: Pixels, threshold: int, *, suppressed: bool) -> NDArray[np.int64]:
    """Plane of cv2's corners: their scores with suppression, 1 without."""
    kind = cv2.FAST_FEATURE_DETECTOR_TYPE_9_16
    plane = np.zeros(gray.shape, np.int64)
    for corner in cv2.FastFeatureDetector.create(threshold, suppressed, kind).detect(gray):
        plane[int(corner.pt[1]), int(corner.pt[0])] = corner.response if suppressed else 1
    return plane


@given(data=st.data(), threshold=st.integers(1, 254))
def test_corner_set_is_opencvs(contents: Callable[..., Any], data: st.DataObject, threshold: int) -> None:
    gray = data.draw(contents(8, 60))
    corners = response_code(gray, threshold) > 0
    np.testing.assert_array_equal(corners, opencv_corners(gray, threshold, suppressed=False))


@given(data=st.data(), threshold=st.integers(1, 254))
def test_suppressed_corners_and_scores_are_opencvs(
    contents: Callable[..., Any], data: st.DataObject, threshold: int
) -> None:
    gray = data.draw(contents(8, 60))
    survivors = suppress(response_code(gray, threshold), 1, "lose")
    np.testing.assert_array_equal(survivors, opencv_corners(gray, threshold, suppressed=True))


def test_score_is_the_largest_threshold_that_opencv_passes(texture: Callable[..., Any]) -> None:
    gray = texture(97, 131)
    largest = np.zeros(gray.shape, np.int64)
    for threshold in range(1, 255):
        largest[opencv_corners(gray, threshold, suppressed=False) > 0] = threshold
    assert (largest > 0).sum() > 500
    np.testing.assert_array_equal(score(gray), largest)
