"""The thesis's own methods, which stand beside the tests, against closed forms and OpenCV."""

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from golden_model.arrays import Array
from skymosaic.compositing.warp import Canvas, footprint, warp_backward
from skymosaic.geometry.fuzzy_ransac import decide
from skymosaic.geometry.homography import DegenerateError, apply, dlt, estimate_similarity
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


def test_many_fours_find_what_each_match_would_get() -> None:
    rng = np.random.default_rng(3)
    verified, errors_px = rng.random(40) < 0.8, rng.choice([1.0, 9.0], 40, p=(0.8, 0.2))
    left, right = off_by(errors_px)
    alone = decide(SHIFT, left, right, verified).inliers
    few, many = (decide_in_sets_of_four(SHIFT, left, right, verified, rng=rng, sets=n) for n in (10, 2000))
    np.testing.assert_array_equal(many, alone)
    assert not (few & ~alone).any()
    assert few.sum() < alone.sum()


@pytest.mark.parametrize("count", [0, 3])
def test_fewer_than_four_matches_give_no_four(count: int) -> None:
    left, right = off_by([0] * count)
    assert decide(SHIFT, left, right, np.ones(count, dtype=bool)).inliers.sum() == count
    together = decide_in_sets_of_four(SHIFT, left, right, np.ones(count), rng=np.random.default_rng(4))
    assert together.shape == (count,)
    assert not together.any()


@pytest.mark.parametrize("count", [4, 5, 60])
def test_exact_pairs_give_the_exact_homography(count: int) -> None:
    left = np.random.default_rng(count).uniform(0, 640, (count, 2))
    np.testing.assert_allclose(estimate_inhomogeneous(left, apply(PROJECTIVE, left)), PROJECTIVE, rtol=1e-9)


def test_four_pairs_agree_with_opencv() -> None:
    left, right = [(0, 0), (639, 0), (639, 479), (0, 479)], [(12, 7), (600, 33), (652, 470), (-8, 431)]
    reference = cv2.getPerspectiveTransform(np.array(left, np.float32), np.array(right, np.float32))
    np.testing.assert_allclose(estimate_inhomogeneous(left, right), reference, rtol=1e-9, atol=1e-12)


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


def test_inhomogeneous_refuses_collinear_points() -> None:
    line = np.column_stack([np.arange(10.0), 2 * np.arange(10.0)])
    with pytest.raises(DegenerateError):
        estimate_inhomogeneous(line, line)


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


def test_models_minimise_the_transfer_error_within_their_freedom() -> None:
    left = scattered(50, seed=6)
    right = apply(AFFINE, left) + np.random.default_rng(7).normal(0, 2, left.shape)
    homogeneous = np.column_stack([left, np.ones(50)])
    affine = np.linalg.lstsq(homogeneous, right, rcond=None)[0].T
    np.testing.assert_allclose(estimate_affine(left, right)[:2], affine, atol=1e-9)

    def cost(model: Any, turn: float = 0.0, growth: float = 1.0) -> Any:
        H = MODELS[model](left, right)
        centre = left.mean(axis=0)
        turned = growth * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        return np.sum((apply(H, centre + (left - centre) @ turned.T) - right) ** 2)

    assert cost("affine") < cost("similarity") < cost("isometry")
    for change in ({"turn": 0.01}, {"turn": -0.01}, {"growth": 1.01}, {"growth": 0.99}):
        assert cost("similarity") < cost("similarity", **change)
    assert cost("isometry") < min(cost("isometry", turn=0.01), cost("isometry", turn=-0.01))


def test_isometry_keeps_lengths_and_never_mirrors() -> None:
    left = scattered(20, seed=8)
    for right in (apply(SIMILARITY, left), left * (1, -1)):
        linear = estimate_isometry(left, right)[:2, :2]
        np.testing.assert_allclose(linear @ linear.T, np.eye(2), atol=1e-12)
        assert np.linalg.det(linear) == pytest.approx(1)


@pytest.mark.parametrize(
    ("model", "points"),
    [
        ("affine", scattered(2, seed=0)),
        ("affine", np.column_stack([np.arange(10.0), 2 * np.arange(10.0)])),
        ("isometry", np.ones((5, 2))),
    ],
)
def test_degenerate_points_are_refused(model: str, points: Array) -> None:
    with pytest.raises(DegenerateError):
        MODELS[model](points, apply(ISOMETRY, points))


ERRORS = [transfer, symmetric, reprojection, sampson]


def noisy_pairs(count: int, sigma_px: float, seed: int, truth: Array = PROJECTIVE) -> tuple[Array, Array]:
    """Noise in both images."""
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, 640, (count, 2))
    right = apply(truth, left) + rng.normal(0, sigma_px, left.shape)
    return left + rng.normal(0, sigma_px, left.shape), right


def test_errors_of_a_shift_by_hand() -> None:
    # (3, 4) off under a pure shift: 25 in one image, 25 in each of both; half the way in each is the nearest.
    shift = np.array([[1.0, 0, 10], [0, 1, 0], [0, 0, 1]])
    found = [squared_errors(shift, [(5, 5)], [(18, 9)], error)[0] for error in ERRORS]
    assert found == pytest.approx([25, 50, 12.5, 12.5])


def test_errors_of_a_zoom_by_hand() -> None:
    # Under a zoom of 2 an offset of 5 right pixels is 2.5 left ones; the nearest pair is 25 / (1 + 2²) away.
    zoom = np.diag([2.0, 2, 1])
    found = [squared_errors(zoom, [(1, 1)], [(5, 6)], error)[0] for error in ERRORS]
    assert found == pytest.approx([25, 31.25, 5, 5])


def test_reprojection_error_against_direct_minimisation() -> None:
    left, right = noisy_pairs(5, 8.0, seed=2)
    for x, y, error in zip(left, right, squared_errors(PROJECTIVE, left, right, reprojection), strict=True):
        nearest = minimize(
            lambda z, x=x, y=y: np.sum((z - x) ** 2) + np.sum((apply(PROJECTIVE, z) - y) ** 2),
            x,
            method="BFGS",
            tol=1e-9,
        )
        assert error == pytest.approx(nearest.fun, rel=1e-6)


@pytest.mark.parametrize("error", ERRORS)
def test_refine_reaches_a_minimum_of_its_own_error(error: Residuals) -> None:
    left, right = noisy_pairs(40, 1.0, seed=3)
    start = dlt(left, right)
    refined = refine(start, left, right, error)

    def cost(h: Any) -> Any:
        return squared_errors(np.append(h, 1).reshape(3, 3), left, right, error).sum()

    h = refined.ravel()[:8]
    assert cost(h) < cost(start.ravel()[:8])
    for direction in np.eye(8):
        step = direction * np.abs(h) * 1e-3
        assert cost(h) < min(cost(h + step), cost(h - step))


def test_reprojection_refinement_against_the_full_bundle() -> None:
    # Independent: all 8 + 2N unknowns at once with numeric derivatives, in coordinates around 1.
    left, right = (points / 320 - 1 for points in noisy_pairs(12, 2.0, seed=4))

    def residuals(unknowns: Any) -> Any:
        exact = unknowns[8:].reshape(-1, 2)
        return np.concatenate([exact - left, apply(np.append(unknowns[:8], 1).reshape(3, 3), exact) - right]).ravel()

    start = dlt(left, right)
    bundle = least_squares(residuals, np.append(start.ravel()[:8], left), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    refined = refine(start, left, right, reprojection)
    np.testing.assert_allclose(refined.ravel()[:8], bundle.x[:8], atol=1e-6)
    assert squared_errors(refined, left, right, reprojection).sum() == pytest.approx(2 * bundle.cost, rel=1e-9)


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


def test_only_reprojection_and_sampson_stand_strong_perspective() -> None:
    # Points near the horizon have large errors in one image, which the symmetric error trusts all the same.
    truth = np.array([[1, 0.1, 20], [-0.1, 1, 10], [3e-3, 1e-3, 1]])
    by_reprojection, by_sampson, *others = mean_distances(truth, 16, reprojection, sampson, symmetric, None)
    assert by_reprojection < 0.97 * min(others)
    assert by_sampson == pytest.approx(by_reprojection, rel=0.01)


def test_bad_input_is_refused() -> None:
    left, right = noisy_pairs(10, 1.0, seed=9)
    with pytest.raises(DegenerateError, match="at least 4"):
        refine(PROJECTIVE, left[:3], right[:3], symmetric)
    with pytest.raises(DegenerateError, match="coincide"):
        refine(PROJECTIVE, np.ones((6, 2)), np.ones((6, 2)), symmetric)


@pytest.mark.parametrize("channels", [(), (3,)], ids=["gray", "bgr"])
def test_forward_whole_pixel_shift_is_exact(channels: tuple[Any, ...]) -> None:
    image = np.random.default_rng(0).integers(0, 256, (40, 60, *channels), dtype=np.uint8)
    shift = np.array([[1.0, 0, 7], [0, 1, -5], [0, 0, 1]])
    warped = warp_forward(image, shift, Canvas(0, -10, 80, 60))
    expected = np.zeros((60, 80, *channels), dtype=np.uint8)
    expected[5:45, 7:67] = image
    np.testing.assert_array_equal(warped, expected)


def test_forward_leaves_holes_where_it_enlarges_and_backward_none() -> None:
    image = np.full((20, 20), 9, np.uint8)
    zoom, canvas = np.diag([2.0, 2, 1]), Canvas(0, 0, 39, 39)
    warped = warp_forward(image, zoom, canvas)
    assert (warped[::2, ::2] == 9).all()
    assert np.count_nonzero(warped) == 400
    assert (warp_backward(image, zoom, canvas) == 9).all()


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


def test_cylinder_of_a_long_lens_is_the_plane() -> None:
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (60, 80), dtype=np.uint8), (0, 0), 4)
    warped = project_to_cylinder(image, 1e6)
    # The arc of 79 px spans 78 whole ones: an even number about the centre.
    assert warped.shape == (60, 79)
    middle = (image[:, :-1].astype(float) + image[:, 1:]) / 2
    np.testing.assert_allclose(warped, middle, atol=0.6)
