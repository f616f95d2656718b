import numpy as np
import pytest

from golden_model.arrays import Array, Points
from skymosaic.compositing.warp import nearness, outline
from skymosaic.flight.layout.extent import MAX_SLANT, MAX_STRETCH, find_misplaced, least_nearness
from skymosaic.flight.linking.links import Link
from skymosaic.geometry.homography import apply
from tests.skymosaic.flight.layout import cameras


def stretch(to_ground: Array, point: Points) -> float:
    """How many times as large a pixel becomes as the one in the middle, along a side."""
    areas = []
    for x, y in (point, cameras.MIDDLE_PX):
        corner, right, below = apply(to_ground, [(x, y), (x + 1e-3, y), (x, y + 1e-3)])
        areas.append(abs(np.linalg.det(np.array([right - corner, below - corner]))))
    return float(np.sqrt(areas[0] / areas[1]))


@pytest.mark.parametrize(("lean_deg", "whole"), [(0, True), (40, True), (50, False), (60, False)])
def test_far_ground_is_shown_at_the_resolution_that_it_has(lean_deg: float, whole: bool) -> None:
    # All look ahead and are tied up to their far border.
    ahead = [cameras.camera(40 * x, 0, lean_deg) for x in range(4)]
    views, links = cameras.views_of(4), cameras.tie_all(ahead, seed=0)
    transforms = {view: np.asarray(np.linalg.inv(camera), np.float64) for view, camera in enumerate(ahead)}
    least = least_nearness(views, transforms, links)
    assert (max(least.values()) == 0) is whole
    for view, nearest in least.items():
        farthest = max(
            stretch(transforms[view], corner) for corner in outline(cameras.SIZE_PX, transforms[view], nearest)
        )
        assert farthest < MAX_STRETCH if whole else farthest == pytest.approx(MAX_STRETCH, rel=0.01)
    # A canvas of a quarter of the resolution has room for all that a camera at 50 degrees shows.
    coarse = least_nearness(views, transforms, links, scale=0.25)
    assert (max(coarse.values()) == 0) is (lean_deg <= 50)


@pytest.mark.parametrize("lean_deg", [75, 85, 90, 95])
def test_a_middle_near_the_horizon_is_no_measure_of_far_ground(lean_deg: float) -> None:
    to_ground = np.asarray(np.linalg.inv(cameras.camera(0, 0, lean_deg)), np.float64)
    # Ties nearly reach the horizon.
    column = np.array([[cameras.MIDDLE_PX[0], y] for y in np.arange(480.0)])
    seen = column[nearness(cameras.SIZE_PX, to_ground, column) > 0.02]
    link = Link(0, 1, seen, seen, len(seen), len(seen))
    least = least_nearness(cameras.views_of(2), {0: to_ground, 1: to_ground}, [link])[0]
    x, y = seen[nearness(cameras.SIZE_PX, to_ground, seen) >= least][0]
    corner, right, below = apply(to_ground, [(x, y), (x + 1e-3, y), (x, y + 1e-3)])
    slant = np.linalg.norm(below - corner) / np.linalg.norm(right - corner)
    assert slant == pytest.approx(MAX_SLANT * MAX_STRETCH ** (2 / 3), rel=0.05)


def test_a_skew_view_is_none_of_the_horizon_and_views_far_too_large_are_found() -> None:
    """Its pixels are twenty times as long as wide near the camera, too."""
    skew = np.array([[20, 0, 0], [0, 1, 0], [0, 1e-4, 1]])
    points = np.random.default_rng(0).uniform(0, 480, (20, 2))
    link = Link(0, 1, points, points, 20, 20)
    assert least_nearness(cameras.views_of(2), {0: skew, 1: skew}, [link]) == {0: 0.0, 1: 0.0}
    # The second of them has a neighbour of its own size, and one of the others'.
    points = np.random.default_rng(0).uniform(100, 400, (20, 2))
    scale = [1.0, 1, 1, 1000, 1000]
    transforms = {view: np.diag([scale[view], scale[view], 1]) for view in range(5)}
    links = [Link(left, right, points, points, 20, 20) for left, right in ((0, 1), (0, 2), (1, 2), (2, 3), (3, 4))]
    found = find_misplaced(cameras.views_of(5), transforms, links, [np.zeros(20)] * 5)
    assert found == {3: "it would show 1e+03 times as much ground as the photographs that it is linked with"}
