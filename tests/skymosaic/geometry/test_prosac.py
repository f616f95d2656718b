from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array
from skymosaic.evaluation.metrics import grid_error
from skymosaic.geometry import prosac
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import MAX_SAMPLES, MIN_INLIERS, Estimate, estimate_homography

TRUTH = np.array([[0.9, 0.2, 30.0], [-0.15, 1.1, -20.0], [1e-4, -5e-5, 1.0]])
SIZE = (640, 480)


def matches(
    count: int, inlier_share: float, seed: int, *, noise_px: float = 0.5, truth: Array = TRUTH
) -> tuple[Any, ...]:
    """Matches in random order; the weights say nothing about which are right."""
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, SIZE, (count, 2))
    right = apply(truth, left) + rng.normal(0, noise_px, left.shape)
    wrong = rng.permutation(count) >= inlier_share * count
    right[wrong] = rng.uniform(0, SIZE, (wrong.sum(), 2))
    return left, right, rng.uniform(64, 255, count), ~wrong


def estimated(left: Array, right: Array, weight: Array, seed: int = 0, **options: Any) -> Estimate:
    return estimate_homography(left, right, weight, rng=np.random.default_rng(seed), **options)


@pytest.mark.parametrize("seed", range(5))
def test_finds_the_homography_among_seventy_percent_outliers(seed: int) -> None:
    left, right, weight, correct = matches(300, 0.3, seed)
    estimate = estimated(left, right, weight)
    assert estimate.homography is not None
    assert grid_error(estimate.homography, TRUTH, SIZE, SIZE) < 0.35
    # 2 px are four sigma of a coordinate; a wrong match comes that close hardly ever.
    assert (estimate.inliers & correct).sum() >= 0.97 * correct.sum()
    assert (estimate.inliers & ~correct).sum() <= 2


def test_same_rng_same_result_and_order_of_matches_is_free() -> None:
    left, right, weight, _ = matches(200, 0.3, seed=2)
    first, second = estimated(left, right, weight, seed=7), estimated(left, right, weight, seed=7)
    np.testing.assert_array_equal(first.homography, second.homography)
    order = np.random.default_rng(3).permutation(200)
    shuffled = estimated(left[order], right[order], weight[order], seed=7)
    assert first.homography is not None
    assert shuffled.homography is not None
    np.testing.assert_allclose(shuffled.homography, first.homography, rtol=1e-9)
    np.testing.assert_array_equal(shuffled.inliers, first.inliers[order])


def test_easy_pairs_stop_early_and_good_weights_make_hard_ones_easy(monkeypatch: pytest.MonkeyPatch) -> None:
    easy = matches(200, 0.9, seed=4)[:3]
    # One batch of one search: no other plane can gain as much.
    assert estimated(*easy).samples == prosac.BATCH
    monkeypatch.setattr(prosac, "CLEAR_SHARE", 1.0)
    assert estimated(*easy).samples == prosac.RESTARTS * prosac.BATCH
    left, right, weight, correct = matches(400, 0.06, seed=5)
    telling = np.where(correct, weight + 200, weight)
    blind, guided = (estimated(left, right, w, max_samples=128) for w in (weight, telling))
    assert blind.homography is None
    assert guided.homography is not None
    assert grid_error(guided.homography, TRUTH, SIZE, SIZE) < 0.5


def test_unrelated_images_are_refused_and_few_matches_searched_once() -> None:
    for seed in range(10):
        left, right, weight, _ = matches(400, 0.0, seed)
        estimate = estimated(left, right, weight)
        assert estimate.homography is None
        assert estimate.inliers.sum() < MIN_INLIERS
        assert estimate.samples == prosac.RESTARTS * MAX_SAMPLES
    left, right, weight, _ = matches(prosac.BEST_MATCHES, 0.0, seed=3)
    assert estimated(left, right, weight).samples == MAX_SAMPLES


def test_the_best_matches_are_searched_where_all_show_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right, weight, correct = matches(400, 0.05, seed=4, noise_px=0.2)
    weight[:] = 100
    weight[np.flatnonzero(correct)[:12]] = 200
    weight[np.flatnonzero(~correct)[:36]] = 200

    def count_found() -> int:
        return sum(estimated(left, right, weight, seed).homography is not None for seed in range(3))

    assert count_found() == 3
    monkeypatch.setattr(prosac, "BEST_MATCHES", 400)
    assert count_found() == 0


@pytest.mark.parametrize(("correct", "accepted"), [(11, False), (12, True)])
def test_twelve_inliers_are_needed(correct: int, accepted: bool) -> None:
    left, right, weight, _ = matches(correct, 1.0, seed=6, noise_px=0.1)
    estimate = estimated(left, right, weight)
    assert estimate.inliers.sum() == correct
    assert (estimate.homography is not None) is accepted


def test_inliers_are_within_two_pixels() -> None:
    left, right, weight, _ = matches(200, 1.0, seed=15, noise_px=0.01)
    right[:3] += np.array([(1.8, 0), (0, -2.2), (1.5, 1.5)])
    np.testing.assert_array_equal(estimated(left, right, weight).inliers[:4], [True, False, False, True])


@pytest.mark.parametrize("shift_px", [3, 6])
def test_a_start_from_elsewhere_competes_with_what_the_search_finds(shift_px: float) -> None:
    left, right, weight, _ = matches(300, 0.4, seed=17)
    start = np.array([[1.0, 0, shift_px], [0, 1, 0], [0, 0, 1]]) @ TRUTH
    alone = estimated(left, right, weight, restarts=0, starts=[start])
    assert alone.samples == 0
    assert grid_error(alone.homography, TRUTH, SIZE, SIZE) < 0.35
    hopeless = TRUTH + np.array([[0, 0, 300.0], [0, 0, 0], [0, 0, 0]])
    both = estimated(left, right, weight, restarts=0, starts=[hopeless, start])
    np.testing.assert_array_equal(both.homography, alone.homography)
    assert estimated(left[:3], right[:3], weight[:3], restarts=0, starts=[start]).homography is None


def test_a_turned_but_not_mirrored_view_is_found() -> None:
    # Every match fits a homography exactly, but one that turns the ground over.
    mirror = np.array([[-1.0, 0, 639], [0, 1, 0], [0, 0, 1]])
    left, right, weight, _ = matches(100, 1.0, seed=7, truth=mirror)
    assert estimated(left, right, weight).homography is None
    turned = np.array([[-0.8, 0.1, 600.0], [-0.1, -0.8, 470], [-2e-5, 1e-5, 1]])
    left, right, weight, _ = matches(100, 0.5, seed=8, truth=turned)
    estimate = estimated(left, right, weight)
    assert grid_error(estimate.homography, turned, SIZE, SIZE) < 0.5


LINE = np.column_stack([np.linspace(0, 600, 50), np.linspace(10, 400, 50)])


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (np.zeros((0, 2)), np.zeros((0, 2))),
        (np.eye(2), np.eye(2)),
        (LINE[:3], LINE[:3]),
        (LINE, LINE),
        (np.full((50, 2), 7.0), np.full((50, 2), 9.0)),
        (LINE, np.full((50, 2), 9.0)),
        (np.repeat(LINE[[0, 9, 30]], 20, axis=0), np.repeat(LINE[[0, 9, 30]], 20, axis=0)),
    ],
    ids=["none", "two", "three", "collinear", "one point", "collapsed", "three points repeated"],
)
def test_degenerate_matches_are_refused_quietly(left: Array, right: Array) -> None:
    estimate = estimated(left, right, np.ones(len(left)))
    assert estimate.homography is None
    assert estimate.inliers.shape == (len(left),)
