import functools
from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array
from skymosaic.flight.layout.layout import lay_out
from skymosaic.flight.layout.linked_group import LinkedGroup, normalisation
from skymosaic.flight.layout.motions import FOCAL_HALF_DIAGONALS
from skymosaic.flight.layout.self_calibration import calibrate
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply
from tests.skymosaic.flight import made

SIZE_PX = (1280, 960)


def bent(points: Array, k1: float, k2: float = 0, x: float = 0, y: float = 0) -> Array:
    squared = ((points - [x, y]) ** 2).sum(axis=1, keepdims=True)
    return [x, y] + (points - [x, y]) * (1 + k1 * squared + k2 * squared**2)


@functools.cache
def lawnmower(
    *distortion: float, rows: int = 3, columns: int = 5, noise_px: float = 0.3, seed: int = 0, valley: float = 0.0
) -> tuple[list[View], list[Link]]:
    """Views by a slightly tilted camera with a bending lens, and the links between neighbours.

    The ground is flat, or a valley along the first row whose sides rise with the square of the distance.
    """
    rng = np.random.default_rng(seed)
    unit = normalisation(SIZE_PX)
    half_px = 1 / unit[0, 0]
    poses = []
    for row in range(rows):
        for column in range(columns):
            turn, (tilt_x, tilt_y) = rng.normal(0, 0.03), rng.normal(0, 0.02, 2)
            scale = 1 + rng.normal(0, 0.02)
            cos, sin = scale * np.cos(turn), scale * np.sin(turn)
            poses.append(np.array([[cos, -sin, 0.45 * column], [sin, cos, 0.5 * row], [tilt_x, tilt_y, 1]]))
    ground = rng.uniform((-1.2, -1.2), (0.45 * columns + 1, 0.5 * rows + 1), (6000, 2))
    limits = np.array(SIZE_PX) / 2 / half_px
    projections = []
    for pose in poses:
        straight = apply(np.asarray(np.linalg.inv(pose), np.float64), ground)
        points = bent(straight * (1 + valley * ground[:, 1:] ** 2), *distortion)
        # Far outside, a bending inwards would fold the ground back into the picture.
        inside = (np.abs(points) < limits).all(axis=1) & (np.linalg.norm(straight, axis=1) < 1.3)
        pixels = apply(np.asarray(np.linalg.inv(unit), np.float64), points)
        projections.append((inside, pixels + rng.normal(0, noise_px, points.shape)))
    links = []
    for left in range(len(poses)):
        for right in range(left + 1, len(poses)):
            (in_left, left_points), (in_right, right_points) = projections[left], projections[right]
            both = np.flatnonzero(in_left & in_right)
            if len(both) > 150:
                chosen = rng.choice(both, 150, replace=False)
                links.append(Link(left, right, left_points[chosen], right_points[chosen], 150, 150))
    return made.views(len(poses), SIZE_PX), links


@pytest.mark.parametrize("distortion", [-0.08, 0.05])
def test_distortion_is_found_within_five_percent(distortion: float) -> None:
    views, links = lawnmower(distortion)
    calibration = calibrate(views, range(len(views)), links)
    # One term, where more explain no more.
    assert calibration.distortion == pytest.approx([distortion], rel=0.05)
    assert calibration.lens.numbers["k1"] == pytest.approx(distortion * FOCAL_HALF_DIAGONALS**2, rel=0.05)
    assert calibration.after_px < calibration.before_px


def test_a_strong_lens_beside_the_middle_is_found() -> None:
    views, links = lawnmower(-0.2, 0.04, 0.05, -0.03)
    calibration = calibrate(views, range(len(views)), links)
    assert calibration.distortion == pytest.approx([-0.2, 0.04, 0.05, -0.03], abs=0.005)
    assert calibration.after_px < 0.3 * calibration.before_px
    half_px = np.hypot(*SIZE_PX) / 2
    centre = calibration.lens.numbers["centre_x_px"], calibration.lens.numbers["centre_y_px"]
    assert centre == pytest.approx((np.array(SIZE_PX) - 1) / 2 + half_px * calibration.distortion[2:])
    upright = made.view(size=SIZE_PX[::-1], working_size=SIZE_PX)
    assert len(calibrate([*views[:-1], upright], range(len(views)), links).distortion) == 1
    # A lens is that of the photographs as they are stored; where they are turned in two ways, it has no one centre.
    turned = made.views(len(views), SIZE_PX, orientation=3)
    lens = calibrate(turned, range(len(views)), links).lens
    assert lens.numbers["centre_x_px"] == pytest.approx(SIZE_PX[0] - 1 - centre[0])
    assert lens.turned_back(3).numbers == pytest.approx(calibration.lens.numbers)
    assert len(calibrate([*views[:-1], turned[0]], range(len(views)), links).distortion) == 1


def test_a_straight_lens_is_left_alone_and_errors_are_those_of_ties_that_no_fit_has_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    views, links = lawnmower(0.0)
    every, taken, build = set(range(40)), list[set[int]](), LinkedGroup.network

    def network(group: LinkedGroup, chosen: slice, *more: Any) -> Any:
        taken.append(set(range(40)[chosen]))
        return build(group, chosen, *more)

    monkeypatch.setattr(LinkedGroup, "network", network)
    assert calibrate(views, range(len(views)), links) is None
    lay_out(views, list(range(len(views))), links)
    parts = [each for each in taken if each != every]
    assert len(parts) == 6
    for fitted, judging in zip(parts[::2], parts[1::2], strict=True):
        assert (fitted & judging, fitted | judging) == (set(), every)


def test_relief_that_looks_like_a_lens_is_none_and_hides_none() -> None:
    """Along a valley, what rises to both sides is displaced as by a lens, but only along the way."""
    views, links = lawnmower(0.0, rows=1, columns=8, valley=0.15, seed=2)
    assert calibrate(views, range(len(views)), links) is None
    views, links = lawnmower(-0.1, rows=1, columns=8, valley=0.1)
    assert calibrate(views, range(len(views)), links).distortion[0] < 0
