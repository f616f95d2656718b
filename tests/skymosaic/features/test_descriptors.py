import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.config import PRESETS
from golden_model.feature import ilbp
from golden_model.front_end import extract
from golden_model.pixel.smooth import binomial
from sim.scene import make_pair
from skymosaic.features.descriptors import DESCRIPTORS, describe
from skymosaic.features.detectors import detect, key_point_positions, to_key_points

FLIGHT = make_pair(seed=1)


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return list(FLIGHT.images)


@pytest.fixture(scope="module")
def gray(images: list[np.ndarray]) -> np.ndarray:
    return cv2.cvtColor(images[0], cv2.COLOR_BGR2GRAY)


@pytest.mark.parametrize(("name", "opencv"), [
    ("sift", lambda: cv2.SIFT.create(1000, contrastThreshold=0.02)),
    ("orb", lambda: cv2.ORB.create(1000, fastThreshold=10)),
    ("akaze", lambda: cv2.xfeatures2d.AKAZE.create(threshold=1e-4)),
    ("brisk", lambda: cv2.xfeatures2d.BRISK.create(thresh=15)),
])  # fmt: skip
def test_features_are_those_of_opencv(gray: np.ndarray, name: str, opencv: Callable[..., Any]) -> None:
    points, values = opencv().compute(gray, detect(gray, name, 1000)[:1000])
    records = describe(gray, detect(gray, name, 1000)[:1000], name)
    np.testing.assert_array_equal(records["descriptor"], values.astype(np.uint8))
    np.testing.assert_allclose(records["x"] / 16, key_point_positions(points)[:, 0], atol=1 / 32)
    np.testing.assert_allclose(records["y"] / 16, key_point_positions(points)[:, 1], atol=1 / 32)


def test_ilbp_of_harris_corners_is_the_front_ends_own(gray: np.ndarray) -> None:
    config = dataclasses.replace(PRESETS["thesis"].front_end, threshold=30_000)
    features = extract(gray, config).features
    again = describe(gray, to_key_points(features), config.descriptor)
    whole = (features["x"] % 16 != 8) & (features["y"] % 16 != 8)  # half a pixel off, the nearest is either
    assert whole.sum() > 300
    for field in ("x", "y", "sector", "descriptor", "window"):
        np.testing.assert_array_equal(again[field][whole], features[field][whole])


@pytest.mark.parametrize("descriptor", [name for name in DESCRIPTORS if name not in ("akaze", "klt")])
def test_what_a_descriptor_drops_at_the_border_stays_in_step(gray: np.ndarray, descriptor: str) -> None:
    height, width = gray.shape
    pixels = list(itertools.product(range(0, width, 40), range(0, height, 40)))
    points = [cv2.KeyPoint(x, y, 7, 0, 1 + index) for index, (x, y) in enumerate(pixels)]
    records = describe(gray, points, descriptor)
    if descriptor != "sift":
        assert 0 < len(records) < len(points)
    assert set(zip(records["x"] // 16, records["y"] // 16, strict=True)) <= set(pixels)
    # Each survivor alone has the descriptor that it had among the others.
    for index in (0, len(records) // 2, len(records) - 1):
        pixel = int(records["x"][index]) // 16, int(records["y"][index]) // 16
        alone = describe(gray, [points[pixels.index(pixel)]], descriptor)
        np.testing.assert_array_equal(alone["descriptor"][0], records["descriptor"][index])


@pytest.mark.parametrize("descriptor", DESCRIPTORS)
def test_no_key_points_give_no_records_of_the_same_kind(gray: np.ndarray, descriptor: str) -> None:
    empty = describe(gray, [], descriptor)
    assert len(empty) == 0
    detector = "akaze" if descriptor == "akaze" else "orb"
    points = detect(gray, detector, 20)
    assert empty.dtype == describe(gray, points, descriptor).dtype


def test_ilbp_at_sift_key_points_reads_the_nearest_pixel(gray: np.ndarray) -> None:
    pattern = ilbp.PATTERNS["ilbp-128"]
    points = [cv2.KeyPoint(100.4, 120.6, 7)]
    record = describe(gray, points, "ilbp-128")
    expected = ilbp.describe(gray, binomial(gray, 5), np.array([100]), np.array([121]), pattern)
    np.testing.assert_array_equal(record["sector"], expected[0])
    np.testing.assert_array_equal(record["descriptor"], expected[1])
