"""What moves with the camera, an on-screen display or dirt on the lens, is not taken for the ground."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sim.scene import make_lawnmower, make_pair
from skymosaic import mosaics, register
from skymosaic.errors import RegistrationError

SIZE = (640, 480)


def with_display(image: np.ndarray) -> np.ndarray:
    """A drone's display: text in the corners and along the borders, a cross in the middle."""
    shown = image.copy()
    for y, line in ((25, "H 120.4 m  D 381 m  REC 00:41"), (465, "HS 5.2 m/s VS 0.0 GPS 17 ISO 100"), (50, "BAT 61 %")):
        cv2.putText(shown, line, (12, y), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2)
    cv2.drawMarker(shown, (320, 240), (255, 255, 255), cv2.MARKER_CROSS, 30, 2)
    return shown


def with_dirt(image: np.ndarray) -> np.ndarray:
    """Dirt on the glass before the lens, dark and sharp."""
    shown, rng = image.copy(), np.random.default_rng(4)
    for x, y in rng.integers(30, (SIZE[0] - 30, SIZE[1] - 30), (20, 2)).tolist():
        cv2.fillPoly(shown, [np.array((x, y)) + rng.integers(-22, 23, (9, 2))], (5, 5, 5))
    return shown


@pytest.fixture(scope="module")
def sites() -> list[np.ndarray]:
    """Photographs of three places that have nothing in common."""
    return [make_pair(seed=seed, size=SIZE).images[0] for seed in (5, 6, 7)]


@pytest.mark.parametrize("cover", [with_display, with_dirt])
def test_what_stands_still_joins_no_different_places(sites: list[NDArray[np.uint8]], cover: Callable[..., Any]) -> None:
    pair = register(cover(sites[0]), cover(sites[1]))
    assert not pair.accepted
    assert "stands still" in pair.reason


def test_three_places_with_one_display_are_no_mosaic(sites: list[NDArray[np.uint8]]) -> None:
    with pytest.raises(RegistrationError, match="could be linked"):
        list(mosaics([with_display(site) for site in sites]))


@pytest.mark.parametrize("cover", [with_display, with_dirt])
def test_the_ground_behind_it_is_registered(cover: Callable[..., Any]) -> None:
    left, right = make_pair(seed=5, size=SIZE).images
    plain, covered = register(left, right), register(cover(left), cover(right))
    assert covered.accepted
    corners = np.array([(0, 0, 1), (640, 0, 1), (640, 480, 1), (0, 480, 1)], dtype=float).T
    one, other = ((h @ corners)[:2] / (h @ corners)[2] for h in (plain.homography, covered.homography))
    assert np.abs(one - other).max() < 3


def test_copies_of_one_photograph_are_told(sites: list[NDArray[np.uint8]]) -> None:
    pair = register(sites[0], sites[0].copy())
    assert pair.accepted
    assert pair.right.notes == ("the same picture as left image",)


def test_a_camera_that_hovers_sees_the_ground(sites: list[NDArray[np.uint8]]) -> None:
    rng = np.random.default_rng(1)
    left, right = (np.clip(sites[0] + rng.normal(0, 4, sites[0].shape), 0, 255).astype(np.uint8) for _ in range(2))
    pair = register(left, right)
    assert pair.accepted
    assert not pair.right.notes


def test_a_flight_behind_a_display_is_whole() -> None:
    images = [with_display(image) for image in make_lawnmower(1, 4, SIZE).images]
    (whole,) = mosaics(images)
    assert len(whole.placed) == 4
