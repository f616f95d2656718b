import numpy as np
import pytest

from skymosaic.compositing.mesh import Ties
from skymosaic.flight.layout.adjustment import Network
from skymosaic.flight.layout.expected_shape import are_possible
from skymosaic.flight.layout.motions import shapes
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


@pytest.mark.parametrize("model", ["similarity", "affine"])
def test_a_model_leaves_what_it_does_not_have_alone(model: str) -> None:
    rng = np.random.default_rng(4)
    refined = network(true_transforms(5, rng), rng, 0.3).adjust(np.tile(np.eye(3), (5, 1, 1)), model)
    np.testing.assert_allclose(refined[:, 2], [[0, 0, 1]] * 5, atol=1e-12)
    if model == "similarity":
        np.testing.assert_allclose(shapes(refined), 0, atol=1e-9)


def test_a_step_that_overshoots_is_damped() -> None:
    """The ties of the second view are those of a mirror; the undamped step turns the view inside out."""
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.6, 0.6, (60, 2))
    mirrored = Ties(0, 1, points, points * np.array([-1, 1]))
    ties = Network([mirrored], [UNIT_PX] * 2, 0)
    start = np.tile(np.eye(3), (2, 1, 1))
    refined = ties.adjust(start, "homography")
    assert are_possible(refined).all()
    assert np.median(ties.errors_px(refined)) <= np.median(ties.errors_px(start))
