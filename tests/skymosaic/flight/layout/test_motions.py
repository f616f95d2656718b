import numpy as np
import pytest

from sim.scene import Camera, CameraPose
from skymosaic.flight.layout.motions import (
    FOCAL_HALF_DIAGONALS,
    bending_of,
    generators,
    shapes,
    straighten,
    stretch_of_tilt,
)
from skymosaic.geometry.homography import apply


def test_generators_are_the_derivative_of_the_motions() -> None:
    points = np.random.default_rng(0).uniform(-0.7, 0.7, (20, 2))
    step = 1e-6
    matrices = {  # one small motion each, as the module's docstring lists them
        0: [[1, 0, step], [0, 1, 0], [0, 0, 1]],
        1: [[1, 0, 0], [0, 1, step], [0, 0, 1]],
        2: [[1, -step, 0], [step, 1, 0], [0, 0, 1]],
        3: [[1 + step, 0, 0], [0, 1 + step, 0], [0, 0, 1]],
        4: [[1 + step, 0, 0], [0, 1 - step, 0], [0, 0, 1]],
        5: [[1, step, 0], [step, 1, 0], [0, 0, 1]],
        6: [[1, 0, 0], [0, 1, 0], [step, 0, 1]],
        7: [[1, 0, 0], [0, 1, 0], [0, step, 1]],
    }
    derivative = generators(points, 8)
    for motion, matrix in matrices.items():
        moved = (apply(np.array(matrix), points) - points) / step
        np.testing.assert_allclose(derivative[:, :, motion], moved, atol=1e-5)


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(12, 0), (0, -9), (8, 6)])
def test_a_leaning_camera_stretches_as_its_tilt_tells(pitch_deg: int, roll_deg: int) -> None:
    half_px = FOCAL_HALF_DIAGONALS * 500
    camera = Camera(width_px=801, height_px=601, focal_px=FOCAL_HALF_DIAGONALS * half_px)
    pose = CameraPose(x_px=3, y_px=-8, altitude_px=700, heading_deg=25, pitch_deg=pitch_deg, roll_deg=roll_deg)
    to_pixels = np.array([[half_px, 0, 400], [0, half_px, 300], [0, 0, 1]])
    shape = shapes((np.linalg.inv(pose.homography(camera)) @ to_pixels)[None])
    assert np.abs(shape[0, :2]).max() > 5e-3
    np.testing.assert_allclose(shape[:, :2], stretch_of_tilt(shape[:, 2:]), atol=1e-9)


@pytest.mark.parametrize("terms", [(), (0.1,), (-0.15, 0.04), (-0.15, 0.04, 0.05, -0.03)])
def test_straightening_undoes_the_bending(terms: tuple[float, ...]) -> None:
    distortion, step = np.array(terms), 1e-6
    k1, k2, *centre = *terms, *[0.0] * (4 - len(terms))
    points = np.random.default_rng(1).uniform(-0.6, 0.6, (100, 2))
    squared = ((points - centre) ** 2).sum(axis=1, keepdims=True)
    bent = centre + (points - centre) * (1 + k1 * squared + k2 * squared**2)
    np.testing.assert_allclose(straighten(bent, distortion), points, atol=1e-4)
    moves = [straighten(bent, distortion + step * each) - straighten(bent, distortion) for each in np.eye(len(terms))]
    expected = np.stack(moves, axis=-1) / step if moves else np.zeros((100, 2, 0))
    np.testing.assert_allclose(bending_of(points, distortion), expected, atol=2e-4)
