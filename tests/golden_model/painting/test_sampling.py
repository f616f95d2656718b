"""Colours are SciPy's bilinear ones in double precision, and weights grow from the border of the frame inwards."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from golden_model.arrays import Array, Pixels
from golden_model.painting.positions import POSITION, positions
from golden_model.painting.sampling import sample, weigh
from tests.golden_model.painting import tilted

NEEDED_DB = 57
ZOOMS, TURNS = (0.5, 1.0, 1.5, 2.0), (0.0, 0.3, 2.2, 3.9)


def bilinear(frame: Pixels, points: Array) -> Array:
    """Colours (..., 3) at points (..., 2), in double precision."""
    at = [points[..., 1], points[..., 0]]
    channels = [
        map_coordinates(frame[..., n].astype(float), at, order=1, mode="nearest") for n in range(frame.shape[2])
    ]
    return np.stack(channels, axis=-1)


def psnr(difference: Array) -> float:
    return float(10 * np.log10(255**2 / np.mean(difference**2)))


def check_warps(frame: Pixels) -> None:
    """Every tile of a canvas, at each zoom and heading: all of the chip's roundings against none."""
    size = (frame.shape[1], frame.shape[0])
    tile = tilted.all_tiles()
    for zoom, turn in zip(ZOOMS, TURNS, strict=True):
        H = tilted.pose(size, zoom=zoom, turn=turn)
        colours, weights = sample(frame, positions(tilted.corners(H, tile)))
        inside = weights > 0
        assert inside.sum() > 25_000
        assert psnr(colours[inside] - bilinear(frame, tilted.pixels(H, tile)[inside])) > NEEDED_DB


@given(height=st.integers(2, 40), width=st.integers(2, 40), seed=st.integers(0, 99))
def test_colours_are_rounded_once(height: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame = rng.choice(np.array([0, 1, 128, 254, 255], np.uint8), (height, width, 3))
    at = rng.integers(-3 * POSITION.one, POSITION.one * np.array([width + 3, height + 3]), (200, 2))
    colours, weights = sample(frame, at)
    expected = np.floor(bilinear(frame, at / POSITION.one) + 0.5)
    np.testing.assert_array_equal(colours[weights > 0], expected[weights > 0])
    # Outside is where one of the four pixels is missing.
    whole = at >> POSITION.fraction_bits
    np.testing.assert_array_equal(weights > 0, ((whole >= 0) & (whole + 1 < (width, height))).all(axis=1))


def test_a_warp_is_near_that_of_double_precision(texture: Callable[..., Pixels]) -> None:
    noise = np.stack([texture(300, 401, seed) for seed in range(3)], axis=-1)
    # As sharp as what a lens shows; the error of a position counts by the slope of the picture.
    check_warps(np.asarray(cv2.GaussianBlur(noise, None, 1.2)))


@pytest.mark.parametrize("name", ["real_copr_24_26_right", "real_brighton_1_3_left", "real_happy_D_left"])
def test_a_warped_photograph_is_near_that_of_double_precision(public_data: Path, name: str) -> None:
    photograph = cv2.imread(str(public_data / "registration" / "images" / f"{name}.jpg"))
    assert photograph is not None
    check_warps(photograph)


@pytest.mark.parametrize(("width", "height"), [(24, 510), (511, 900), (512, 512), (1920, 1080), (4096, 4096), (2, 2)])
def test_weights_rise_from_the_border_to_the_middle_of_any_frame(width: int, height: int) -> None:
    largest = min(width, height) // 2
    weights = weigh(np.arange(-3, largest + 1), width, height)
    np.testing.assert_array_equal(weights[:5], [0, 0, 0, 0, 1])
    assert set(np.diff(weights[4:])) <= {0, 1}
    assert min(largest, 128) <= weights[-1] <= 255


def test_the_border_is_the_nearest_of_four() -> None:
    frame = np.zeros((31, 43, 3), np.uint8)
    y, x = np.indices((30, 42))
    _, weights = sample(frame, np.stack([x, y], axis=-1) * POSITION.one + 17)
    inside = np.zeros((32, 44), np.uint8)
    inside[1:-1, 1:-1] = 1
    expected = cv2.distanceTransform(inside, cv2.DIST_C, 3)[1:-1, 1:-1]
    np.testing.assert_array_equal(weights, expected)
