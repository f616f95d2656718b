import numpy as np
import pytest

from sim.scene import Camera, CameraPose, make_lawnmower
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.seams import find_allowed
from skymosaic.compositing.warp import enclosing

CAMERA = Camera(width_px=160, height_px=120, focal_px=128)


def seen(pose: CameraPose, camera: Camera = CAMERA) -> Layer:
    """A photograph of nothing, where the camera would take it."""
    image = np.zeros((camera.height_px, camera.width_px, 3), np.uint8)
    return Layer(image, np.asarray(np.linalg.inv(pose.homography(camera)), np.float64))


def hovering(count: int) -> list[Layer]:
    rng = np.random.default_rng(count)
    return [
        seen(CameraPose(x_px=x, y_px=y, altitude_px=128 * rng.normal(1, 0.01), heading_deg=rng.normal(0, 1.5)))
        for x, y in rng.normal(0, 3, (count, 2)).tolist()
    ]


@pytest.mark.parametrize("count", [100, 400])
def test_of_many_photographs_of_one_place_few_reach_the_seam_finder(count: int) -> None:
    layers = hovering(count)
    needed = list(find_allowed(layers))
    assert needed == sorted(set(needed))
    assert 5 <= len(needed) <= 40
    # No ground is lost, and the sum of all that has left owned little.
    whole = enclosing([layer.footprint for layer in layers])
    shown, left = (np.zeros((whole.height_px, whole.width_px)) for _ in range(2))
    for number, layer in enumerate(layers):
        claims = shown if number in needed else left
        where = layer.footprint.within(whole)
        claims[where] = np.maximum(claims[where], layer.claim(layer.footprint))
    assert (shown[left > 0] >= 0.6 * left[left > 0]).all()


def test_all_photographs_of_a_survey_are_needed() -> None:
    flight = make_lawnmower(seed=4, images=25, size=(160, 120), forward_overlap=0.8, side_overlap=0.7)
    assert list(find_allowed([seen(pose, flight.camera) for pose in flight.poses])) == list(range(25))


def test_a_photograph_that_alone_shows_a_corner_stays() -> None:
    whole, small = seen(CameraPose(x_px=0, y_px=0, altitude_px=128)), Camera(width_px=100, height_px=80, focal_px=128)
    inside, beyond = (seen(CameraPose(x_px=0, y_px=y, altitude_px=128, heading_deg=30), small) for y in (0, 3))
    assert list(find_allowed([whole, inside])) == [0]
    assert 0 < (beyond.claim(beyond.footprint) > whole.claim(beyond.footprint)).sum() < 0.01 * 100 * 80
    assert list(find_allowed([whole, beyond])) == [0, 1]
