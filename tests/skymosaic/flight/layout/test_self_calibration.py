from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.flight.layout.layout import lay_out
from skymosaic.flight.layout.linked_group import normalisation
from skymosaic.flight.layout.motions import FOCAL_HALF_DIAGONALS
from skymosaic.flight.layout.self_calibration import calibrate, straighten_links
from skymosaic.flight.linking.links import Link
from skymosaic.geometry.homography import apply

SIZE_PX = (1280, 960)


def bent(points: NDArray[np.float64], distortion: float) -> NDArray[np.float64]:
    return points * (1 + distortion * (points**2).sum(axis=1, keepdims=True))


def lawnmower(
    distortion: float, rows: int = 3, columns: int = 5, noise_px: float = 0.3, seed: int = 0
) -> tuple[list[Any], list[Link]]:
    """Views of flat ground by a slightly tilted camera with a bending lens, and the links between neighbours."""
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
        points = bent(straight, distortion)
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
    return [SimpleNamespace(size=SIZE_PX, working_size=SIZE_PX) for _ in poses], links


@pytest.mark.parametrize("distortion", [-0.08, -0.03, 0.05])
def test_distortion_is_found_within_five_percent(distortion: float) -> None:
    views, links = lawnmower(distortion)
    calibration = calibrate(views, range(len(views)), links)
    assert calibration.distortion == pytest.approx(distortion, rel=0.05)
    assert calibration.k1 == pytest.approx(distortion * FOCAL_HALF_DIAGONALS**2, rel=0.05)
    assert calibration.after_px < calibration.before_px


def test_a_straight_lens_is_left_alone() -> None:
    views, links = lawnmower(0.0)
    assert calibrate(views, range(len(views)), links) is None


def test_straightened_links_fit_as_well_as_those_of_a_straight_lens() -> None:
    views, links = lawnmower(-0.06)
    _, straight_links = lawnmower(0.0)
    calibration = calibrate(views, range(len(views)), links)
    members = list(range(len(views)))
    straight = list(straighten_links(links, views, dict.fromkeys(range(len(views)), calibration.distortion)).values())
    after = lay_out(views, members, straight).median_error_px
    assert after < 1.2 * lay_out(views, members, straight_links).median_error_px
    assert after < lay_out(views, members, links).median_error_px


def test_different_cameras_and_few_views_are_left_alone() -> None:
    views, links = lawnmower(-0.06)
    other: Any = SimpleNamespace(size=(640, 480), working_size=SIZE_PX)
    assert calibrate([*views[:-1], other], range(len(views)), links) is None
    few, few_links = lawnmower(-0.1, rows=1, columns=4)
    assert calibrate(few, range(len(few)), few_links) is None
