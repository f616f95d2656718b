# amaranth: UnusedElaboratable=no
"""The estimator equals the golden model, clocks included, frame after frame; its states end in the golden causes.

It stands for tests of `ordering`, `processor` and `estimator_states`: the order of matches, and what is done when,
decide on samples and clocks.
"""

import numpy as np
import pytest

from golden_model.config import PRESETS, EstimatorConfig
from golden_model.geometry import estimator as golden
from golden_model.geometry.estimator import CYCLES, EstimateCause, FrameMatches
from hdl.geometry.estimator import GATHER_CYCLES, HomographyEstimator
from hdl.geometry.estimator_states import TURN_CYCLES
from hdl.geometry.sweep import Sweep
from sim.backends.golden import GoldenBackend
from sim.scene import make_pair
from sim.simulators.recording import Pauses
from tests.hdl.geometry.estimator_bench import MAX_MATCHES, assert_equal, frame, simulate_estimates


def test_estimates_equal_the_golden_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """Matches of the next frame arrive while those before are in use.

    Only the first 4 of the 16 steps are searched. The first frame is refitted in mid-search; the second has no time for
    it after a step that found a better homography, the third has as many matches as fit.
    """
    model, states = "golden_model.geometry.estimator", "hdl.geometry.estimator_states"
    for module in ("golden_model.geometry.sampling", states):
        monkeypatch.setattr(f"{module}.STEPS", 4)
    for module in (model, states):
        monkeypatch.setattr(f"{module}.SEARCH_CYCLES", 2_250)
        monkeypatch.setattr(f"{module}.MAX_REFITTED_OFTEN", 28)
    chosen = (28, 2, 6), (28, 3, 19), (29, 2, 23)
    frames = [(frame(count, 1)[0], EstimatorConfig(passes=passes, seed=seed)) for count, passes, seed in chosen]
    frames.append(frame(3, 2))
    cycles = [golden.estimate(*each).cycles for each in frames]
    limits = ("MAX_REFITTED_OFTEN", 0), ("SEARCH_CYCLES", 9_000), ("MAX_REFITTED_OFTEN", 29)
    for number, (limit, value) in enumerate(limits):
        with monkeypatch.context() as patch:
            patch.setattr(f"{model}.{limit}", value)
            assert golden.estimate(*frames[number]).cycles != cycles[number]
    results = simulate_estimates(frames, max_matches=MAX_MATCHES, cycle_limit=30_000)
    assert_equal(results, frames)
    assert [result.causes for result in results] == [0, 0, 0, EstimateCause.TOO_FEW_MATCHES]


def test_frames_without_a_homography_have_their_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search has 4 steps instead of 16."""
    for module in ("golden_model.geometry.sampling", "hdl.geometry.estimator_states"):
        monkeypatch.setattr(f"{module}.STEPS", 4)
    pauses = Pauses(gaps=100, stalls=180, seed=3)
    some, settings = frame(4, 3)
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
    assert CYCLES.sweep == Sweep.latency_cycles + 2
    assert CYCLES.gather == GATHER_CYCLES + 3
    assert CYCLES.turn == TURN_CYCLES + 2


@pytest.mark.parametrize("max_matches", [3, 2049])
def test_an_impossible_memory_is_refused(max_matches: int) -> None:
    with pytest.raises(ValueError, match=f"max_matches is {max_matches}; it must be a whole number from 4 to 2048"):
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
