"""The states end in the golden model's causes, after its clocks, where there is no homography."""

import numpy as np
import pytest

from golden_model.config import EstimatorConfig
from golden_model.geometry.estimator import CYCLES, EstimateCause
from hdl.geometry.estimator_states import TURN_CYCLES
from sim.simulators.recording import Pauses
from tests.hdl.geometry.estimator_bench import MAX_MATCHES, assert_equal, frame, simulate_estimates


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


def test_the_model_of_time_knows_the_turn() -> None:
    assert CYCLES.turn == TURN_CYCLES + 2
