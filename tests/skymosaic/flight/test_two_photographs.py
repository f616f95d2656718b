"""Two photographs as a small flight."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.scene import CameraPose
from skymosaic import mosaic
from skymosaic.compositing.warp import nearness
from skymosaic.evaluation.metrics import grid_error
from skymosaic.flight.layout.extent import least_nearness
from skymosaic.flight.linking.links import Link
from skymosaic.flight.two_photographs import choose_mesh
from tests.skymosaic.flight.layout.cameras import views_of
from tests.skymosaic.registration.rendering import CAMERA, view


def test_a_pair_with_a_horizon_becomes_a_mosaic_without_the_far_field() -> None:
    """A corner of the left photograph shows what lies behind the right camera."""
    poses = [
        CameraPose(x_px=0, y_px=0, altitude_px=250, heading_deg=heading_deg, pitch_deg=50) for heading_deg in (0, 80)
    ]
    result = mosaic([view(pose, seed) for seed, pose in enumerate(poses)])
    to_left, to_right = (pose.homography(CAMERA) for pose in poses)
    truth = to_right @ np.linalg.inv(to_left)
    size = (CAMERA.width_px, CAMERA.height_px)
    assert nearness(size, truth, CAMERA.corners).min() < 0
    assert grid_error(result.pairs[0].homography, truth, size, size) < 2
    left, right = result.composition.placements
    assert 0.3 < left.cut_off < 0.9
    assert right.cut_off == 0
    assert 1.2 * size[0] * size[1] < np.count_nonzero(result.image) < 5 * size[0] * size[1]


@pytest.mark.parametrize(("warp", "matrix"), [("homography", np.eye(3)), ("mesh", None), ("auto", None)])
def test_a_pair_keeps_its_shape_unless_a_mesh_is_wanted_and_it_was_registered(warp: str, matrix: Any) -> None:
    pair: Any = SimpleNamespace(working_homography=matrix)
    assert choose_mesh(pair, warp) == {}


def test_a_pair_without_matches_on_its_plane_is_not_cut() -> None:
    nothing = np.zeros((0, 2))
    link = Link(0, 1, nothing, nothing, inliers=0, near=0)
    assert least_nearness(views_of(2), {0: np.eye(3), 1: np.eye(3)}, [link]) == {0: 0.0, 1: 0.0}
