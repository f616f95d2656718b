"""The thesis's own methods, which stand beside the tests, against closed forms and OpenCV."""

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Array
from skymosaic.compositing.warp import footprint, warp_backward
from skymosaic.geometry.homography import apply, dlt, estimate_similarity
from tests.skymosaic.geometry.test_homography import ISOMETRY, PROJECTIVE, scattered
from tests.skymosaic.thesis.reference.fuzzy_ransac import decide_in_sets_of_four
from tests.skymosaic.thesis.reference.least_squares import estimate_inhomogeneous
from tests.skymosaic.thesis.reference.plane_models import estimate_affine, estimate_isometry
from tests.skymosaic.thesis.reference.refinement import (
    Residuals,
    refine,
    reprojection,
    sampson,
    squared_errors,
    symmetric,
    transfer,
)
from tests.skymosaic.thesis.reference.warping import project_to_cylinder, warp_forward

SHIFT = np.array([[1.0, 0, 10], [0, 1, 0], [0, 0, 1]])


def off_by(errors_px: list[Any] | NDArray[Any]) -> tuple[Array, Array]:
    """Matches with the given transfer errors under `SHIFT`."""
    left = np.random.default_rng(0).uniform(0, 400, (len(errors_px), 2))
    return left, left + np.column_stack([10 + np.asarray(errors_px, dtype=float), np.zeros(len(errors_px))])


def test_one_bad_match_spoils_its_four() -> None:
    left, right = off_by([0, 0, 0, 0])
    rng = np.random.default_rng(2)
    assert decide_in_sets_of_four(SHIFT, left, right, [1, 1, 1, 1], rng=rng, sets=1).all()
    assert not decide_in_sets_of_four(SHIFT, left, right, [1, 1, 1, 0], rng=rng, sets=50).any()
    left, right = off_by([0, 0, 0, 5])
    assert not decide_in_sets_of_four(SHIFT, left, right, [1, 1, 1, 1], rng=rng, sets=50).any()


def test_inhomogeneous_is_the_normal_equations_solution() -> None:
    left = np.random.default_rng(1).uniform(0, 640, (30, 2))
    # Centred, with mean distance sqrt(2), so that the thesis's h33 = 1 is fixed in the same coordinates.
    left = (left - left.mean(axis=0)) / np.linalg.norm(left - left.mean(axis=0), axis=1).mean() * np.sqrt(2)
    right = left + np.random.default_rng(2).normal(0, 0.01, left.shape)
    right = (right - right.mean(axis=0)) / np.linalg.norm(right - right.mean(axis=0), axis=1).mean() * np.sqrt(2)
    rows, target = [], []
    for (x, y), (u, v) in zip(left, right, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        target += [u, v]
    A, b = np.array(rows), np.array(target)
    h = np.linalg.inv(A.T @ A) @ A.T @ b
    np.testing.assert_allclose(estimate_inhomogeneous(left, right).ravel()[:8], h, atol=1e-12)


SIMILARITY = np.array([[1.2, -0.5, 7.0], [0.5, 1.2, -3.0], [0.0, 0.0, 1.0]])
AFFINE = np.array([[1.1, 0.3, 4.0], [-0.2, 0.7, 8.0], [0.0, 0.0, 1.0]])
MODELS = {
    "isometry": estimate_isometry,
    "similarity": estimate_similarity,
    "affine": estimate_affine,
    "projective": dlt,
}


@pytest.mark.parametrize(
    ("model", "truth", "count"),
    [("isometry", ISOMETRY, 2), ("similarity", SIMILARITY, 2), ("affine", AFFINE, 3), ("projective", PROJECTIVE, 4)],
)
def test_each_model_recovers_its_own_transformation(model: str, truth: Array, count: int) -> None:
    left = scattered(count, seed=5)
    np.testing.assert_allclose(MODELS[model](left, apply(truth, left)), truth, atol=1e-9)


ERRORS = [transfer, symmetric, reprojection, sampson]


def noisy_pairs(count: int, sigma_px: float, seed: int, truth: Array = PROJECTIVE) -> tuple[Array, Array]:
    """Noise in both images."""
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, 640, (count, 2))
    right = apply(truth, left) + rng.normal(0, sigma_px, left.shape)
    return left + rng.normal(0, sigma_px, left.shape), right


def test_errors_of_a_zoom_by_hand() -> None:
    # Under a zoom of 2 an offset of 5 right pixels is 2.5 left ones; the nearest pair is 25 / (1 + 2²) away.
    zoom = np.diag([2.0, 2, 1])
    found = [squared_errors(zoom, [(1, 1)], [(5, 6)], error)[0] for error in ERRORS]
    assert found == pytest.approx([25, 31.25, 5, 5])


def mean_distances(truth: Array, count: int, *errors: Residuals | None) -> list[float]:
    """Mean over seeds 0 to 39 of the mean distance over a grid, for noise of 1 px in both images; None: of the DLT."""
    grid = np.stack(np.meshgrid(np.linspace(0, 640, 9), np.linspace(0, 640, 9)), axis=-1).reshape(-1, 2)
    distance = np.zeros(len(errors))
    for seed in range(40):
        left, right = noisy_pairs(count, 1.0, seed, truth)
        start = dlt(left, right)
        estimates = [refine(start, left, right, error) if error else start for error in errors]
        distance += [np.linalg.norm(apply(H, grid) - apply(truth, grid), axis=1).mean() / 40 for H in estimates]
    return distance.tolist()


def test_better_models_of_the_noise_are_closer_to_the_truth() -> None:
    truth = np.array([[0.5, 0.1, 20], [-0.1, 0.5, 10], [-6e-4, -4e-4, 1]])
    by_reprojection, by_symmetric, by_dlt = mean_distances(truth, 12, reprojection, symmetric, None)
    assert by_reprojection < by_symmetric < by_dlt


def test_forward_agrees_with_backward_on_a_smooth_image() -> None:
    # The nearest pixel is at most half a pixel off along x and y, turned here; the ramp rises by 1 along both.
    ramp = np.add.outer(np.arange(100), np.arange(120)).astype(np.uint8)
    turn = np.array([[0.8, -0.6, 60], [0.6, 0.8, 0], [0, 0, 1]])
    canvas = footprint((120, 100), turn)
    there, back = warp_forward(ramp, turn, canvas), warp_backward(ramp, turn, canvas, border=cv2.BORDER_REPLICATE)
    hit = there > 0
    assert hit.sum() > 0.9 * ramp.size
    assert np.abs(there[hit].astype(int) - back[hit]).max() <= 2


def test_cylinder_turns_a_pan_into_a_shift() -> None:
    # A dot seen under 0.2 rad lands f * 0.2 px beside the centre, at its elevation's tangent times f.
    focal_px = 500.0
    image = np.zeros((201, 601), dtype=np.uint8)
    x, y = 300 + focal_px * np.tan(0.2), 100 + 50 / np.cos(0.2)
    cv2.circle(image, (round(x * 16), round(y * 16)), 6 * 16, 255, -1, cv2.LINE_AA, 4)
    warped = project_to_cylinder(image, focal_px)
    assert warped.shape == (201, 2 * int(focal_px * np.arctan(0.6)) + 1)
    rows, columns = np.nonzero(warped > 127)
    assert columns.mean() - (warped.shape[1] - 1) / 2 == pytest.approx(100, abs=0.3)
    assert rows.mean() == pytest.approx(150, abs=0.3)
