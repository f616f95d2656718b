from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import Config
from sim.backends.golden import GoldenBackend
from sim.backends.interface import FrameResult, Reference
from sim.scene import Camera, CameraPose, Photometry, render_ground, render_view
from sim.scene.camera import find_visible_box
from skymosaic import register
from skymosaic.errors import InputError
from skymosaic.evaluation.metrics import grid_error

SIZE = (480, 360)
CAMERA = Camera(width_px=SIZE[0], height_px=SIZE[1], focal_px=384)


def view(pose: CameraPose, seed: int) -> NDArray[np.uint8]:
    left, top, width, height = find_visible_box(pose, CAMERA)
    ground = render_ground(1, width, height, (left, top))
    photometry = Photometry(blur_sigma_px=0.4, noise_sigma=1.5)
    image = render_view(ground, pose, CAMERA, photometry, np.random.default_rng(seed), origin=(left, top))
    return image[..., 1].copy()


@pytest.fixture(scope="module")
def near() -> tuple[CameraPose, NDArray[np.uint8]]:
    pose = CameraPose(x_px=60, y_px=40, altitude_px=384)
    return pose, view(pose, 0)


@pytest.fixture(scope="module")
def far() -> tuple[CameraPose, NDArray[np.uint8]]:
    """Three times as high, turned by 40 degrees: the first pass alone cannot match it."""
    pose = CameraPose(x_px=70, y_px=30, altitude_px=3 * 384, heading_deg=40)
    return pose, view(pose, 1)


class Counting(GoldenBackend):
    """Counts the frames that the front end sees."""

    frames = 0

    def run(
        self, frames: Sequence[NDArray[np.uint8]], config: Config, *, reference: Reference = "held"
    ) -> list[FrameResult]:
        self.frames += len(frames)
        return super().run(frames, config, reference=reference)


@pytest.mark.parametrize("swapped", [False, True])
def test_a_zoom_of_three_needs_the_ladder(
    near: tuple[CameraPose, NDArray[np.uint8]], far: tuple[CameraPose, NDArray[np.uint8]], swapped: bool
) -> None:
    one, other = (far, near) if swapped else (near, far)
    truth = other[0].homography(CAMERA) @ np.linalg.inv(one[0].homography(CAMERA))
    assert not register(one[1], other[1], effort="fast").accepted
    pair = register(one[1], other[1])
    assert pair.effort == "normal"
    assert pair.accepted, pair.reason
    assert pair.passes > 2
    assert grid_error(pair.homography, truth, SIZE, SIZE) < 2
    for side in ("left", "right"):
        features, index = pair.features[side == "right"], pair.inliers[f"{side}_index"]
        np.testing.assert_array_equal(features["x"][index], pair.inliers[f"{side}_x"])


def test_a_strong_first_pass_is_enough(near: tuple[CameraPose, NDArray[np.uint8]]) -> None:
    backend = Counting()
    pair = register(near[1], near[1], backend=backend)
    assert (pair.passes, backend.frames) == (1, 2)
    assert register(near[1], near[1], effort="thorough").passes == 3


def test_unrelated_images_are_refused_at_every_effort(near: tuple[CameraPose, NDArray[np.uint8]]) -> None:
    other = view(CameraPose(x_px=4000, y_px=5000, altitude_px=384), 2)
    for effort in ("fast", "normal", "thorough"):
        pair = register(near[1], other, effort=effort)
        assert not pair.accepted
        assert pair.confidence is None
        assert "too few" in pair.reason


def test_the_seed_hardly_matters(
    near: tuple[CameraPose, NDArray[np.uint8]], far: tuple[CameraPose, NDArray[np.uint8]]
) -> None:
    shapes = [register(near[1], far[1], seed=seed).homography for seed in range(3)]
    corners = np.array([[0.0, 0, 1], [479, 0, 1], [479, 359, 1], [0, 359, 1]])
    mapped = [(corners @ H.T)[:, :2] / (corners @ H.T)[:, 2:] for H in shapes]
    assert np.ptp(mapped, axis=0).max() < 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"effort": "heroic"}, "fast, normal, thorough"),
        ({"effort": "thorough", "preset": "thesis"}, "oriented ILBP"),
        ({"effort": "normal", "estimator": "magsac"}, "magsac"),
        ({"effort": "normal", "backend": "board:somewhere"}, "a board takes one"),
    ],
)
def test_an_effort_that_cannot_apply_is_refused(
    near: tuple[CameraPose, NDArray[np.uint8]], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        register(near[1], near[1], **options)


def test_other_methods_take_one_pass_by_default(near: tuple[CameraPose, NDArray[np.uint8]]) -> None:
    assert register(near[1], near[1], detector="orb").effort == "fast"
