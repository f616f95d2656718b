from typing import Any

import numpy as np
import pytest

from sim.scene import Camera, CameraPose
from skymosaic.flight.layout.adjustment import (
    FOCAL_HALF_DIAGONALS,
    Network,
    Ties,
    bending_of,
    generators,
    shapes,
    straighten,
    stretch_of_tilt,
)
from skymosaic.geometry.homography import apply

UNIT_PX = 800.0


def true_transforms(views: int, rng: np.random.Generator) -> np.ndarray:
    """Views in a row, each turned, scaled and tilted a little; the first is where the reference is."""
    transforms = np.tile(np.eye(3), (views, 1, 1))
    for index in range(1, views):
        turn, grow = rng.normal(0, 0.05), 1 + rng.normal(0, 0.02)
        transforms[index, :2, :2] = grow * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        transforms[index, :2, 2] = 0.5 * index, rng.normal(0, 0.02)
        tilt = np.eye(3)
        tilt[2, :2] = rng.normal(0, 0.01, 2)
        transforms[index] = transforms[index] @ tilt
    return transforms


def ties_between(transforms: np.ndarray, left: int, right: int, rng: np.random.Generator, noise_px: float) -> Ties:
    points = rng.uniform(-0.6, 0.6, (60, 2))
    mapped = apply(np.linalg.inv(transforms[right]) @ transforms[left], points)
    return Ties(left, right, points, mapped + rng.normal(0, noise_px / UNIT_PX, mapped.shape))


def network(transforms: np.ndarray, rng: np.random.Generator, noise_px: float) -> Network:
    views = len(transforms)
    pairs = [(i, i + step) for step in (1, 2) for i in range(views - step)]
    ties = [ties_between(transforms, left, right, rng, noise_px) for left, right in pairs]
    return Network(ties, [UNIT_PX] * views, 0)


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


def test_shapes_of_a_similarity_are_zero_and_of_a_stretch_its_size() -> None:
    turned = np.array([[0.9, -0.4, 3.0], [0.4, 0.9, -1.0], [0, 0, 1]])
    np.testing.assert_allclose(shapes(turned[None])[0], 0, atol=1e-12)
    stretched = turned @ np.diag([1.003, 0.997, 1.0])
    np.testing.assert_allclose(shapes(stretched[None])[0], [0.003, 0, 0, 0], atol=1e-12)
    tilted = turned @ np.array([[1, 0, 0], [0, 1, 0], [0.02, -0.01, 1]])
    np.testing.assert_allclose(shapes(tilted[None])[0, 2:], [0.02, -0.01], atol=1e-12)


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(12, 0), (0, -9), (8, 6)])
def test_a_leaning_camera_stretches_as_its_tilt_tells(pitch_deg: int, roll_deg: int) -> None:
    half_px = FOCAL_HALF_DIAGONALS * 500
    camera = Camera(width_px=801, height_px=601, focal_px=FOCAL_HALF_DIAGONALS * half_px)
    pose = CameraPose(x_px=3, y_px=-8, altitude_px=700, heading_deg=25, pitch_deg=pitch_deg, roll_deg=roll_deg)
    to_pixels = np.array([[half_px, 0, 400], [0, half_px, 300], [0, 0, 1]])
    shape = shapes((np.linalg.inv(pose.homography(camera)) @ to_pixels)[None])
    assert np.abs(shape[0, :2]).max() > 5e-3
    np.testing.assert_allclose(shape[:, :2], stretch_of_tilt(shape[:, 2:]), atol=1e-9)


def test_exact_ties_give_the_true_mappings_between_views() -> None:
    rng = np.random.default_rng(1)
    true = true_transforms(8, rng)
    ties = network(true, rng, noise_px=0.0)
    start = true.copy()
    start[1:, :2, 2] += rng.normal(0, 0.02, (7, 2))
    start[:, 2, :2] = 0
    refined = ties.adjust(start, "homography")
    assert np.concatenate(ties.errors_px(refined)).max() < 0.02


def test_a_tenth_of_wrong_ties_does_no_harm() -> None:
    rng = np.random.default_rng(2)
    true = true_transforms(6, rng)
    links = []
    for left in range(5):
        tie = ties_between(true, left, left + 1, rng, 0.2)
        tie.right_points[:6] += rng.normal(0, 0.1, (6, 2))
        links.append(tie)
    ties = Network(links, [UNIT_PX] * 6, 0)
    refined = ties.adjust(true, "homography")
    good = np.concatenate([error[6:] for error in ties.errors_px(refined)])
    assert np.median(good) < 0.35


def test_the_reference_stays_where_it_is() -> None:
    rng = np.random.default_rng(3)
    true = true_transforms(5, rng)
    refined = network(true, rng, 0.3).adjust(true, "homography")
    np.testing.assert_allclose(refined[0, :2, 2], 0, atol=1e-4)
    np.testing.assert_allclose(shapes(refined)[:, :2], 0, atol=0.004)


@pytest.mark.parametrize("model", ["similarity", "affine"])
def test_a_model_leaves_what_it_does_not_have_alone(model: str) -> None:
    rng = np.random.default_rng(4)
    refined = network(true_transforms(5, rng), rng, 0.3).adjust(np.tile(np.eye(3), (5, 1, 1)), model)
    np.testing.assert_allclose(refined[:, 2], [[0, 0, 1]] * 5, atol=1e-12)
    if model == "similarity":
        np.testing.assert_allclose(shapes(refined), 0, atol=1e-9)


def test_straightening_undoes_the_bending() -> None:
    def bent(points: Any, distortion: Any) -> Any:
        return points * (1 + distortion * (points**2).sum(axis=1, keepdims=True))

    points = np.random.default_rng(1).uniform(-0.7, 0.7, (100, 2))
    np.testing.assert_allclose(straighten(bent(points, -0.2), -0.2), points, atol=1e-4)
    step = 1e-6
    moved = (straighten(bent(points, 0.1), 0.1 + step) - straighten(bent(points, 0.1), 0.1)) / step
    np.testing.assert_allclose(bending_of(points, 0.1), moved, atol=1e-5)
