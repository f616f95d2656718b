"""The estimator on made-up matches: right homographies, causes, and clocks within the limit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from golden_model.config import EstimatorConfig
from golden_model.geometry import programs
from golden_model.geometry.estimator import (
    CYCLES,
    MAX_CYCLES,
    MAX_MATCHES,
    MAX_REFITTED_OFTEN,
    REFIT_MARGIN_LOG2,
    SEARCH_CYCLES,
    Estimate,
    EstimateCause,
    FrameMatches,
    estimate,
    solving_cycles,
)
from golden_model.geometry.program import LANES
from golden_model.geometry.refit import BANDS, MAX_INLIERS
from golden_model.geometry.sampling import STEPS
from golden_model.geometry.solving import MIN_CHECKED_EXPONENT
from skymosaic.evaluation.metrics import grid_error
from skymosaic.geometry.homography import apply

SIZE = (640, 480)
TRUTH = np.array([[1.02, 0.05, 30.0], [-0.04, 0.97, 10.0], [5e-5, 2e-5, 1.0]])
FEW = EstimatorConfig(passes=8)


def matches(count: int, wrong: float, seed: int = 1, noise_px: float = 0.4) -> FrameMatches:
    """Matches near the truth, and wrong ones; these have lower weights on average."""
    rng = np.random.default_rng(seed)
    left = rng.integers(1000, [16 * side - 1000 for side in SIZE], (count, 2))
    right = np.rint(16 * (apply(TRUTH, left / 16) + rng.normal(0, noise_px, left.shape))).astype(np.int64).clip(0)
    is_wrong = rng.random(count) < wrong
    right[is_wrong] = rng.integers(0, [16 * side for side in SIZE], (is_wrong.sum(), 2))
    weight = np.where(is_wrong, rng.integers(60, 200, count), rng.integers(80, 256, count))
    return FrameMatches(left, right, weight, SIZE)


def in_pixels(result: Estimate) -> np.ndarray:
    units = np.array([4096.0, 4096, 1])
    return result.homography * units[:, np.newaxis] / units


RECORDED = {
    40: (
        [16771120, 844220, 118800, -644948, 15962275, 37770, 3546531, 1517687, 16411216],
        {"score": 143617, "support": 4491, "inliers": 28, "cells": 19, "cycles": 48560},
    ),
    MAX_REFITTED_OFTEN + 1: (
        [16757388, 808504, 121621, -662809, 15947986, 40022, 3351726, 1320064, 16438014],
        {"score": 571100, "support": 17963, "inliers": 108, "cells": 38, "cycles": 67344},
    ),
    MAX_MATCHES: (
        [16761980, 826471, 120185, -654297, 15949463, 39490, 3387668, 1393332, 16430913],
        {"score": 8819688, "support": 277384, "inliers": 1651, "cells": 46, "cycles": 287266},
    ),
}
"""By the number of matches, the elements and the rest: with other numbers, chips of before would give other answers."""


@pytest.mark.parametrize(("count", "wrong", "limit_px"), [(40, 0.3, 1.0), (257, 0.6, 0.3), (2048, 0.2, 0.1)])
def test_the_homography_is_found_among_wrong_matches(count: int, wrong: float, limit_px: float) -> None:
    result = estimate(matches(count, wrong), FEW)
    assert result.causes == 0
    assert grid_error(in_pixels(result), TRUTH, SIZE, SIZE) < limit_px
    assert result.inliers > 0.8 * (1 - wrong) * count
    assert result.cells > 15
    assert result.cycles <= MAX_CYCLES
    elements, others = RECORDED[count]
    assert result.homography.ravel().tolist() == elements
    assert {name: getattr(result, name) for name in others} == others


def bad_input(name: str) -> FrameMatches:
    frame = matches(60, 0.0)
    left, right, weight, size, _ = frame
    changes: dict[str, dict[str, Any]] = {
        "none": {"left": left[:0], "right": right[:0], "weight": weight[:0]},
        "three": {"left": left[:3], "right": right[:3], "weight": weight[:3]},
        "line": {"left": np.repeat(left[:, :1], 2, axis=1), "right": np.repeat(right[:, :1], 2, axis=1)},
        "point": {"left": left * 0 + 99, "right": right * 0 + 77},
        "mirrored": {"right": (16 * size[0] - right) * (1, 0) + right * (0, 1)},
        "unlike": matches(60, 1.0, seed=4)._asdict(),
        "crowded": {"left": left // 12 + 3000, "right": left // 12 + 3100},
        "bad": {"good": False},
    }
    return frame._replace(**changes.get(name, {}))


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("none", EstimateCause.TOO_FEW_MATCHES),
        ("three", EstimateCause.TOO_FEW_MATCHES),
        ("line", EstimateCause.NO_HYPOTHESIS),
        ("point", EstimateCause.NO_HYPOTHESIS),
        ("mirrored", EstimateCause.TOO_FEW_INLIERS | EstimateCause.TOO_FEW_CELLS),
        ("unlike", EstimateCause.TOO_FEW_INLIERS),
        ("crowded", EstimateCause.TOO_FEW_CELLS),
        ("memory", EstimateCause.TOO_MANY_MATCHES),
        ("bad", EstimateCause.BAD_FRAME),
        ("seed", EstimateCause.INVALID_SETTINGS),
        ("passes", EstimateCause.INVALID_SETTINGS),
    ],
)
def test_bad_input_has_its_cause_and_is_never_accepted(name: str, cause: EstimateCause) -> None:
    settings = {"seed": EstimatorConfig(seed=0), "passes": EstimatorConfig(passes=0)}
    max_matches = 59 if name == "memory" else MAX_MATCHES
    result = estimate(bad_input(name), settings.get(name, EstimatorConfig(passes=2)), max_matches=max_matches)
    assert result.causes
    assert result.causes & cause or result.causes == EstimateCause.NO_HYPOTHESIS
    assert result.cycles < MAX_CYCLES
    if cause < EstimateCause.TOO_FEW_INLIERS:
        assert (result.score, result.inliers, int(result.homography.any())) == (0, 0, 0)


def test_as_many_inliers_and_cells_as_are_asked_for_are_enough() -> None:
    given, few = matches(30, 0.2), EstimatorConfig(passes=1)
    found = estimate(given, few)
    for more_inliers, more_cells, causes in (
        (0, 0, 0), (1, 0, EstimateCause.TOO_FEW_INLIERS), (0, 1, EstimateCause.TOO_FEW_CELLS),
    ):  # fmt: skip
        asked = replace(few, min_inliers=found.inliers + more_inliers, min_cells=found.cells + more_cells)
        assert estimate(given, asked).causes == causes


def test_a_lucky_sample_does_not_beat_the_least_squares_of_all_inliers() -> None:
    """Whatever the samples are, the homography is as exact as the matches allow."""
    given = matches(150, 0.0, noise_px=0.15)
    for seed in (1, 2):
        result = estimate(given, EstimatorConfig(passes=4, seed=seed))
        assert grid_error(in_pixels(result), TRUTH, SIZE, SIZE) < 0.05


@pytest.mark.parametrize("count", [MAX_REFITTED_OFTEN, MAX_MATCHES])
def test_no_set_of_matches_takes_longer_than_the_limit(count: int) -> None:
    """The search overruns its share by a pass; all else is bounded by the numbers of matches and inliers."""
    assert (SEARCH_CYCLES, MAX_CYCLES, REFIT_MARGIN_LOG2) == (164_800, 300_000, 8)
    # Twice an area is at least 8 px²; the unit is 4096 px, and a mantissa is at least 1/2.
    assert 2.0 ** (MIN_CHECKED_EXPONENT - 1) * 4096**4 == 8**2
    sweep = count + CYCLES.sweep
    longest_pass = CYCLES.turn + max(solving_cycles(LANES), LANES * sweep)
    closing = CYCLES.turn + LANES * sweep
    # Each step ends with the first pass beyond its share, even one that begins late, since these are shorter than that.
    assert longest_pass + closing < SEARCH_CYCLES // STEPS
    rounds = programs.CLEAR.cycles + programs.FIT.cycles + CYCLES.round + sweep
    rounds += min(MAX_INLIERS, count) // programs.GROUP * (programs.ADD.cycles + CYCLES.gather)
    refit = sweep + CYCLES.look + len(BANDS) * rounds
    # Few matches may be refitted twice beyond the limit: before the last step, which then is late, and after it.
    refits = refit * (2 if count <= MAX_REFITTED_OFTEN else 1)
    before = CYCLES.accept + CYCLES.sort + CYCLES.place * count
    search = SEARCH_CYCLES + 2 * (longest_pass + closing)
    assert before + search + refits + sweep + CYCLES.look <= MAX_CYCLES
