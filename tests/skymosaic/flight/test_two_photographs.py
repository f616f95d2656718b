"""Two photographs as a small flight."""

import numpy as np

from sim.scene import CameraPose
from skymosaic import mosaic
from skymosaic.compositing.warp import nearness
from skymosaic.evaluation.metrics import grid_error
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
