# amaranth: UnusedElaboratable=no
"""The estimator equals the golden model, clocks included, frame after frame."""

import dataclasses

import numpy as np
import pytest

from golden_model.config import PRESETS, EstimatorConfig
from golden_model.geometry import estimator as golden
from golden_model.geometry.estimator import CYCLES, Estimate, EstimateCause, FrameMatches
from hdl.geometry.estimator import GATHER_CYCLES, HomographyEstimator
from hdl.geometry.estimator_states import TURN_CYCLES
from hdl.geometry.sweep import Sweep
from sim.backends.golden import GoldenBackend
from sim.scene import make_pair
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.geometry.estimator_bench import simulate_estimates

TRUTH = np.array([[1.02, 0.05, 30], [-0.04, 0.97, 10], [1e-5, 2e-5, 1]])
MAX_MATCHES = 40

Given = tuple[FrameMatches, EstimatorConfig]


def frame(count: int, seed: int) -> Given:
    """Matches near `TRUTH`, and wrong ones."""
    rng, size = np.random.default_rng(seed), np.array((320, 241))
    left = rng.integers(500, 16 * size - 500, (count, 2))
    mapped = np.column_stack((left / 16, np.ones(count))) @ TRUTH.T
    right = np.rint(16 * (mapped[:, :2] / mapped[:, 2:] + rng.normal(0, 0.4, left.shape))).astype(np.int64).clip(0)
    is_wrong = rng.random(count) < 0.3
    right[is_wrong] = rng.integers(0, 16 * size, (is_wrong.sum(), 2))
    matches = FrameMatches(left, right, rng.integers(1, 256, count), (320, 241))
    return matches, EstimatorConfig(passes=1, seed=seed)


def assert_equal(results: list[Estimate], frames: list[Given]) -> None:
    for number, (result, given) in enumerate(zip(results, frames, strict=True)):
        expected = golden.estimate(*given, max_matches=MAX_MATCHES)
        np.testing.assert_array_equal(result.homography, expected.homography, err_msg=f"frame {number}")
        for name in ("score", "support", "inliers", "cells", "causes", "cycles"):
            assert getattr(result, name) == getattr(expected, name), f"frame {number}: {name}"


def test_estimates_equal_the_golden_model() -> None:
    """Accepted and not, in sequence; matches of the next frame arrive while those before are in use."""
    frames = [frame(MAX_MATCHES, 1), frame(5, 2)]
    results = simulate_estimates(frames, max_matches=MAX_MATCHES, cycle_limit=40_000)
    assert_equal(results, frames)
    assert [result.causes for result in results] == [0, EstimateCause.TOO_FEW_INLIERS | EstimateCause.TOO_FEW_CELLS]


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=100, stalls=180, seed=3)], ids=["free", "pauses"])
def test_frames_without_a_homography_have_their_cause(pauses: Pauses) -> None:
    some, settings = frame(8, 3)
    line = some._replace(left=np.repeat(some.left[:, :1], 2, axis=1))
    frames = [
        frame(0, 1),
        frame(3, 2),
        frame(MAX_MATCHES + 1, 4),
        (some._replace(good=False), settings),
        (some, EstimatorConfig(seed=0)),
        (some, EstimatorConfig(passes=0)),
        (line, settings),
    ]
    results = simulate_estimates(frames, max_matches=MAX_MATCHES, pauses=pauses, cycle_limit=40_000)
    assert_equal(results, frames)
    assert [result.causes for result in results] == [
        *[EstimateCause.TOO_FEW_MATCHES] * 2,
        EstimateCause.TOO_MANY_MATCHES,
        EstimateCause.BAD_FRAME,
        *[EstimateCause.INVALID_SETTINGS] * 2,
        EstimateCause.NO_HYPOTHESIS,
    ]


def test_the_model_of_time_knows_the_parts() -> None:
    assert dataclasses.asdict(CYCLES)["turn"] == TURN_CYCLES + 2
    assert CYCLES.sweep == Sweep.latency_cycles + 2
    assert CYCLES.gather == GATHER_CYCLES + 3


@pytest.mark.parametrize("max_matches", [3, 2049])
def test_an_impossible_memory_is_refused(max_matches: int) -> None:
    with pytest.raises(ValueError, match=f"max_matches is {max_matches}; it must be 4 to 2048"):
        HomographyEstimator(max_matches=max_matches)


@pytest.mark.slow
def test_the_demo_pair_gives_the_golden_homography() -> None:
    left, right = GoldenBackend().run(list(make_pair(seed=5, size=(320, 240)).images), PRESETS["aerial"])
    frame = FrameMatches.from_records(right.matches, right.status)
    settings = EstimatorConfig(passes=3)
    assert len(left.features) > 100
    (result,) = simulate_estimates([(frame, settings)], max_matches=len(frame.weight))
    expected = golden.estimate(frame, settings)
    np.testing.assert_array_equal(result.homography, expected.homography)
    assert (result.causes, result.inliers, result.cycles) == (0, expected.inliers, expected.cycles)
    assert result.inliers > 30
