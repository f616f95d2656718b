from dataclasses import replace

import numpy as np
import pytest

from golden_model.arrays import Array, Points
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.mesh import CHECK_CELLS, Frame, Mesh, Ties, fit_meshes
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import apply

SIZE = (640, 480)
HOMOGRAPHY = np.array([[1.0, 0.02, -200], [-0.02, 1, 10], [0, 0, 1]])
FRAMES = {0: Frame(SIZE, HOMOGRAPHY), 1: Frame(SIZE, np.eye(3))}


def fit(left: Points, right: Points) -> tuple[Mesh | None, tuple[float, float]]:
    """The mesh of the left of two images, and the shares of held-out matches within 2 px."""
    meshes, (matches, plain, bent) = fit_meshes(FRAMES, [Ties(0, 1, left, right)], [0])
    return meshes.get(0), (plain / max(matches, 1), bent / max(matches, 1))


def matches(bulge_px: float, wrong: float = 0.1) -> tuple[Array, Array]:
    """Matches under a homography, displaced by a smooth hill; a tenth are wrong."""
    rng = np.random.default_rng(0)
    left = rng.uniform((200, 0), SIZE, (500, 2))
    hill = np.exp(-(((left - (400, 240)) / 110) ** 2).sum(axis=1))
    right = apply(HOMOGRAPHY, left + np.outer(hill, [bulge_px, 0])) + rng.normal(0, 0.3, left.shape)
    stray = rng.uniform(size=500) < wrong
    right[stray] = rng.uniform((0, 0), SIZE, (stray.sum(), 2))
    return left, right


def test_enough_held_out_matches_decide() -> None:
    mesh, (plain, bent) = fit(*matches(6.0))
    assert bent > plain + 0.1
    assert mesh is not None
    assert fit(*matches(0.0))[0] is None  # flat ground
    left, right = matches(20.0, wrong=0.0)
    mesh, (plain, _) = fit(left, right)
    assert mesh is not None
    on_ground = apply(np.linalg.inv(HOMOGRAPHY), right)
    off = np.linalg.norm(mesh.find(left) - on_ground, axis=1)
    near = np.linalg.norm(left - on_ground, axis=1)
    assert (near > 14).sum() > 15
    assert np.median(off[near > 14]) < 2
    # None of those that judge it is so high.
    assert plain == pytest.approx((near[near <= 12] <= 2).mean(), abs=0.01)


@pytest.mark.parametrize("few", [0, 20])
def test_matches_on_the_fields_of_one_colour_cannot_be_held_out(few: int) -> None:
    left, right = matches(8.0)
    light = np.floor(apply(HOMOGRAPHY, left) / SIZE[0] * CHECK_CELLS).astype(int).sum(axis=1) % 2 == 0
    for side in (light, ~light):
        chosen = np.concatenate([np.flatnonzero(side), np.flatnonzero(~side)[:few]])
        assert fit(left[chosen], right[chosen]) == (None, (0.0, 0.0))


def test_a_part_has_the_places_of_the_whole() -> None:
    mesh, large = Mesh(SIZE, np.random.default_rng(3).uniform(-8, 8, (4, 5, 2))), (1280, 960)
    transform = np.array([[0.7, 0.05, 10], [-0.02, 0.8, 0], [0, 0, 1]])
    whole, part = Canvas(0, 0, 900, 700), Canvas(300, 200, 50, 40)
    places = mesh.places(large, transform, whole)
    np.testing.assert_allclose(mesh.places(large, transform, part), places[part.within(whole)], atol=0.05)
    # At twice the size, displacements are twice as large.
    points = apply(np.linalg.inv(transform), np.array([[100.0, 100], [500, 300], [700, 600]]))
    expected = points + 2 * mesh.displacement(points / (np.array(large) - 1) * (np.array(SIZE) - 1))
    np.testing.assert_allclose(places[[100, 300, 600], [100, 500, 700]], expected, atol=0.05)


def test_nothing_appears_beyond_the_horizon() -> None:
    tilt, turn, size = np.radians(80), np.radians(33), (480, 360)
    level = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    seen = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]) @ level
    to_image = np.array([[168.0, 0, 240], [0, 168, 180], [0, 0, 1]]) @ np.column_stack([seen[:, :2], [0, 0, 300]])
    layer = Layer(np.zeros(size[::-1], np.uint8), np.linalg.inv(to_image), least_nearness=0.05)
    part = layer.footprint.grown(400)
    flat, bent = (x.border_distance(part) > 0 for x in (layer, replace(layer, mesh=Mesh(size, np.zeros((4, 5, 2))))))
    assert np.count_nonzero(bent & ~flat) == 0
    assert np.count_nonzero(bent) > 0.99 * np.count_nonzero(flat)
