"""Rendered flights: they overlap as asked, and the homographies between their views are exact."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sim.scene import Photometry, ground, make_lawnmower, make_pair, make_pursuit, project
from sim.scene.flight import Flight
from tests.sim.scene.caches import clear_caches


def gray_view(flight: Flight, index: int) -> NDArray[np.uint8]:
    return cv2.cvtColor(flight.images[index], cv2.COLOR_BGR2GRAY)


def test_images_are_reproducible_and_their_noise_is_their_own() -> None:
    flight = make_pair(9, size=(160, 120))
    assert np.array_equal(flight.images[1], make_pair(9, size=(160, 120)).images[-1])
    flat = np.full((240, 321, 3), 128, np.uint8)
    first, second = (Photometry(noise_sigma=3).apply(flat, np.random.default_rng([3, number])) for number in (0, 1))
    assert not np.array_equal(first, second)


@pytest.mark.parametrize("seed", [9, pytest.param(2, marks=pytest.mark.slow)])
def test_pair_shows_the_same_ground(seed: int) -> None:
    flight = make_pair(seed, (240, 180))
    left, right = (gray_view(flight, index).astype(np.float32) for index in (0, 1))
    homography = flight.homography_between(0, 1)
    warped = cv2.warpPerspective(left, homography, (240, 180))
    inside = cv2.warpPerspective(np.ones_like(left), homography, (240, 180)) > 0.99
    assert inside.mean() > 0.4
    assert np.corrcoef(warped[inside], right[inside])[0, 1] > 0.93
    shifted = np.roll(warped, 2, axis=1)
    assert np.corrcoef(shifted[inside], right[inside])[0, 1] < np.corrcoef(warped[inside], right[inside])[0, 1] - 0.05


def test_homographies_compose() -> None:
    flight = make_lawnmower(2, 5, size=(200, 150))
    direct = flight.homography_between(0, 4)
    chained = flight.homography_between(1, 4) @ flight.homography_between(0, 1)
    assert chained / chained[2, 2] == pytest.approx(direct, abs=1e-9)
    to_ground = np.linalg.inv(flight.homographies[0])
    on_ground = project(to_ground, flight.camera.corners)
    assert project(flight.homographies[4], on_ground) == pytest.approx(project(direct, flight.camera.corners))


@pytest.mark.parametrize("size", [(640, 480), (65, 97)])
@pytest.mark.parametrize("overlap", [0.2, 0.6, 0.8])
def test_pair_overlaps_as_asked(size: tuple[int, int], overlap: float) -> None:
    for seed in range(10):
        assert make_pair(seed, size, overlap).overlap_between(0, 1) == pytest.approx(overlap, abs=0.07)


@pytest.mark.parametrize("size", [(65, 97), (64, 64), (333, 127)])
def test_odd_and_small_sizes(size: tuple[int, int]) -> None:
    flight = make_pair(9, size)
    assert [image.shape for image in flight.images] == [(size[1], size[0], 3)] * 2
    assert flight.images[0].dtype == np.uint8
    assert flight.images[0].std() > 5


def test_lawnmower_overlaps_along_and_across_its_legs() -> None:
    flight = make_lawnmower(7, 60, size=(400, 300), forward_overlap=0.7, side_overlap=0.5)
    backwards = [abs(pose.heading_deg) > 90 for pose in flight.poses]
    leg = backwards.index(True)
    along = [flight.overlap_between(index, index + 1) for index in range(leg - 1)]
    across = [flight.overlap_between(index, 2 * leg - 1 - index) for index in range(leg)]
    assert np.mean(along) == pytest.approx(0.7, abs=0.05)
    assert np.mean(across) == pytest.approx(0.5, abs=0.05)
    positions = np.array([(pose.x_px, pose.y_px) for pose in flight.poses])
    width, height = np.ptp(positions, axis=0)
    assert 0.5 < width / height < 2


def test_lawnmower_renders_only_what_is_asked_for() -> None:
    clear_caches()
    flight = make_lawnmower(6, 500, size=(161, 119))
    assert len(flight.images) == 500
    assert ground._paint_tile.cache_info().misses == 0
    assert flight.images[499].shape == (119, 161, 3)
    assert 0 < ground._paint_tile.cache_info().misses <= 4
    assert ground.CACHED_TILES * ground.TILE_PX**2 * 3 <= 160e6
    with pytest.raises(IndexError):
        flight.images[500]


def test_a_car_keeps_its_shape() -> None:
    to_ground = np.array(make_pursuit(seed=1, images=5).car_to_ground)
    np.testing.assert_array_equal(to_ground[:, 2], [[0, 0, 1]] * 5)
    np.testing.assert_allclose(
        to_ground[:, :2, :2] @ to_ground[:, :2, :2].transpose(0, 2, 1), [np.eye(2)] * 5, atol=1e-12
    )


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="overlap is 1; it must be"):
        make_pair(0, overlap=1)
    with pytest.raises(ValueError, match="side_overlap is -1"):
        make_lawnmower(0, 5, side_overlap=-1)
    with pytest.raises(ValueError, match="images is 0"):
        make_lawnmower(0, 0)
