"""Steady video: the view never leaves the frame, moves evenly, and follows the camera without lag."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array
from sim.benches.exported import host_programs
from tests.system.board.test_painter_driver import PAINTING, shift

FRAME_PX, PICTURE_PX = (640, 480), (320, 256)
CORNERS = np.array([[0, 319, 319, 0, 159.5], [0, 0, 255, 255, 127.5], [1, 1, 1, 1, 1]])
"""Those of the picture, and its middle."""


@pytest.fixture
def driver() -> Iterator[Any]:
    with host_programs(PAINTING) as load:
        yield load("skymosaic_steady")


def turned(degrees: float, x: float, y: float, zoom: float = 1.0) -> Array:
    """Turn about the middle of a frame, and move."""
    c, s = zoom * np.cos(np.deg2rad(degrees)), zoom * np.sin(np.deg2rad(degrees))
    return shift(320 + x, 240 + y) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ shift(-320, -240)


def seen(pose: Array) -> Array:
    """Where the picture's corners and its middle lie."""
    x, y, w = pose @ CORNERS
    assert (w > 0).all()
    return np.array([x / w, y / w])


def is_inside(pose: Array) -> bool:
    return bool((seen(pose) >= 1).all() and (seen(pose) <= np.array([[638], [478]])).all())


def test_a_shaken_camera_is_followed_evenly_and_nothing_black_is_seen(driver: Any) -> None:
    """In turns of a steady flight with gusts, some of which are more than the crop allows for."""
    rng, path, before = np.random.default_rng(4), driver.SteadyPath(FRAME_PX, PICTURE_PX), np.eye(3)
    flight, cameras, poses = np.eye(3), [], []
    for number in range(1, 200):
        gust = rng.normal(0, [1, 6, 6], 3) * (3 if number % 60 == 59 else 1)
        flight = turned(0.2, 12, 0) @ flight
        tilt = np.array([[1, 0, 0], [0, 1, 0], [*rng.normal(0, 1e-5, 2), 1]])
        camera = turned(gust[0], gust[1], gust[2], 1 + rng.normal(0, 0.01)) @ tilt @ flight
        pose = path.follow(number, number - 1, camera @ np.linalg.inv(before))
        before = camera
        assert is_inside(pose), number
        poses.append(pose)
        cameras.append(np.linalg.inv(camera))

    def jerk(views: list[Array]) -> float:
        steps = [seen(np.linalg.inv(a) @ b) for a, b in pairwise(views)]
        return float(np.median(np.linalg.norm(np.diff(steps, axis=0), axis=1)))

    # Without a path, the picture is the middle of each frame, as it is of the first.
    unsteady = jerk([camera @ poses[0] for camera in cameras])
    assert jerk([camera @ pose for camera, pose in zip(cameras, poses, strict=True)]) < unsteady / 10


@pytest.mark.parametrize("missing", [0, 3], ids=["each frame", "every third is refused"])
def test_a_camera_that_does_not_shake_is_followed_without_lag(driver: Any, missing: int) -> None:
    path = driver.SteadyPath(FRAME_PX, PICTURE_PX, smooth_frames=5)
    last, step = 0, turned(2, 9, -4, 1.01)
    for number in range(1, 80):
        if missing and number % missing == 0:
            continue
        pose = path.follow(number, last, np.linalg.matrix_power(step, number - last))
        last = number
    # Nine tenths of the height are seen, which is the narrower side.
    np.testing.assert_allclose(seen(pose)[:, -1], (319.5, 239.5), atol=0.01)
    np.testing.assert_allclose(seen(pose)[:, 2] - seen(pose)[:, 0], np.multiply(0.9 * 480 / 256, (319, 255)), atol=0.01)


def test_a_path_begins_where_the_last_one_is_lost(driver: Any) -> None:
    path = driver.SteadyPath(FRAME_PX, PICTURE_PX, smooth_frames=4)
    middle = path.follow(7, 6, shift(90, 0))
    np.testing.assert_allclose(seen(middle)[:, -1], (319.5, 239.5))
    assert not np.allclose(path.follow(8, 7, shift(9, 0)), middle)
    for number, reference in ((9, 7), (14, 9)):
        np.testing.assert_array_equal(path.follow(number, reference, shift(9, 0)), middle)
    path.follow(15, 14, shift(9, 0))
    path.begin()
    np.testing.assert_array_equal(path.follow(16, 15, shift(9, 0)), middle)


TILT = np.array([[1, 0, 0], [0, 1, 0], [-0.004, 0, 1]])
WILD = [turned(180, 0, 0), shift(4000, 0), turned(0, 0, 0, 3), turned(0, 0, 0, 0.2), TILT]


@pytest.mark.parametrize("wild", WILD)
def test_a_wild_homography_shows_nothing_black_and_is_soon_forgotten(driver: Any, wild: Array) -> None:
    path, step = driver.SteadyPath(FRAME_PX, PICTURE_PX, smooth_frames=8), shift(6, 2)
    for number in range(1, 120):
        pose = path.follow(number, number - 1, wild if number == 30 else step)
        assert is_inside(pose), number
    np.testing.assert_allclose(seen(pose)[:, -1], (319.5, 239.5), atol=2)


@pytest.mark.parametrize("options", [{"crop": 0}, {"crop": 0.6}, {"smooth_frames": 0}, {"crop": float("nan")}])
def test_what_cannot_be_is_refused(driver: Any, options: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="at least 1"):
        driver.SteadyPath(FRAME_PX, PICTURE_PX, **options)
