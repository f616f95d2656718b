"""PROSAC by the integer scores of the hardware: as good as in floating point, and the same with the hardware itself."""

import csv
import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.geometry.scoring import LEVELS, MAX_MATCHES
from sim.scene import make_pair
from skymosaic import register
from skymosaic.geometry import estimators, prosac
from skymosaic.geometry.homography import apply
from skymosaic.geometry.scored import integer_scorer
from tests.hdl.geometry.scoring_bench import simulate_scoring

TRUTH = np.array([[0.98, 0.11, 25.0], [-0.09, 1.03, 60.0], [3e-5, -2e-5, 1.0]])


def matches(count: int, seed: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Left, right and falling weights; a third are wrong."""
    rng = np.random.default_rng(seed)
    left = np.rint(16 * rng.uniform(0, 600, (count, 2))) / 16
    right = apply(TRUTH, left) + rng.normal(0, 0.5, left.shape)
    wrong = rng.random(count) < 1 / 3
    right[wrong] = rng.uniform(0, 600, (wrong.sum(), 2))
    return left, np.rint(16 * right) / 16, np.sort(rng.integers(1, 256, count))[::-1].astype(float)


def test_integer_scores_rank_like_those_in_floating_point() -> None:
    given = matches(300)
    rng = np.random.default_rng(2)
    spread = np.array([[1e-3, 1e-3, 1], [1e-3, 1e-3, 1], [1e-6, 1e-6, 1e-9]])
    homographies = TRUTH + rng.normal(size=(200, 3, 3)) * spread
    exact, integer = (scoring(*given)(homographies) for scoring in (prosac.transfer_scorer, integer_scorer))
    # The integer gain is rounded up to a whole step.
    assert (integer / LEVELS >= 0.999 * exact).all()
    assert (integer / LEVELS - exact <= given[2].sum() / LEVELS).all()
    assert np.corrcoef(exact, integer)[0, 1] > 0.999


def test_matches_that_cannot_be_stored_do_not_count() -> None:
    left, right, weight = matches(MAX_MATCHES + 50)
    left[3] = (-0.1, 5)
    right[7] = (4096, 5)
    stored = np.delete(np.arange(MAX_MATCHES + 2), [3, 7])
    scores = integer_scorer(left, right, weight)(TRUTH[np.newaxis])
    assert scores > 0
    assert scores == integer_scorer(left[stored], right[stored], weight[stored])(TRUTH[np.newaxis])


def same_with_the_hardware(
    left: Path | Pixels, right: Path | Pixels, monkeypatch: pytest.MonkeyPatch, **options: Any
) -> None:
    """Register once with the golden scores and once with the simulated block's."""
    # Few samples, since a simulated hypothesis takes as many clocks as there are matches.
    monkeypatch.setattr(prosac, "BATCH", 24)
    monkeypatch.setattr(prosac, "CONFIDENCE", 0.9)
    golden = register(left, right, estimator="scored", effort="fast", **options)
    hypotheses = []

    def simulated(h: Any, *stored: Any) -> Any:
        hypotheses.append(len(h))
        return simulate_scoring(h, *stored)

    monkeypatch.setitem(estimators.SCORINGS, "scored", functools.partial(integer_scorer, score=simulated))
    hardware = register(left, right, estimator="scored", effort="fast", **options)
    assert golden.accepted
    assert sum(hypotheses) > 10
    np.testing.assert_array_equal(hardware.homography, golden.homography)
    np.testing.assert_array_equal(hardware.inliers, golden.inliers)


def test_a_rendered_pair_gives_the_same_homography_with_the_hardware(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right = make_pair(seed=2, size=(160, 120)).images
    same_with_the_hardware(left, right, monkeypatch)


def test_a_real_pair_gives_the_same_homography_with_the_hardware(
    public_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = public_data / "registration"
    with (folder / "pairs.csv").open(newline="") as file:
        row = next(row for row in csv.DictReader(file) if row["group"] == "real")
    same_with_the_hardware(folder / row["left"], folder / row["right"], monkeypatch, working_width_px=320)
