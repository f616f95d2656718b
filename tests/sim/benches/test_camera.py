"""The camera's bench as the bus of the exported scorer, over an accelerator that takes its time."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Records
from golden_model.geometry.scoring import answers, homography_elements, quantise
from golden_model.records import HYPOTHESIS, MATCH
from hdl.build import BUILDS
from hdl.settings import PAGE_BYTES
from sim.benches.camera import POLL_CLOCKS, CameraBench
from sim.benches.exported import host_programs

MATCHES, FRAME = 30, 7


class Simulated(CameraBench):
    """Answers hypotheses as the golden model does, ``delay_clocks`` later; no design is compiled."""

    def __init__(self, matches: Records, delay_clocks: int) -> None:
        self.matches, self.delay_clocks = matches, delay_clocks
        self.memory, self._used = np.zeros(1 << 17, np.uint8), 0
        self.asked = 0

    def run(self, clocks: int) -> None:
        self.left_clocks -= clocks

    def send_hypotheses(self, words: NDArray[np.uint64], *, ends: bool = True) -> None:
        assert ends
        sent = words.view(HYPOTHESIS.dtype)
        self.hypotheses = np.array([homography_elements(each) for each in sent])
        self.left_clocks = self.delay_clocks

    def take_scores(self) -> NDArray[np.uint8] | None:
        self.asked += 1
        return None if self.left_clocks > 0 else answers(self.hypotheses, self.matches, FRAME).view(np.uint8)


@pytest.fixture
def matches() -> Records:
    """Matches of a camera that has moved by 5 px."""
    found = np.zeros(MATCHES, MATCH.dtype)
    found["verdict"], found["weight"] = 1, np.arange(1, MATCHES + 1)
    found["left_x"], found["left_y"] = np.random.default_rng(0).integers(100, 4000, (2, MATCHES))
    found["right_x"], found["right_y"] = found["left_x"] + 80, found["left_y"]
    return found


@pytest.mark.parametrize("polls", [1, 4])
def test_scores_are_waited_for(matches: Records, polls: int) -> None:
    homographies = np.array([np.eye(3), [[1, 0, 5], [0, 1, 0], [0, 0, 1]], [[1, 0, 4], [0, 1, 0], [0, 0, 1]]])
    bench: Any = Simulated(matches, polls * POLL_CLOCKS)
    with host_programs(BUILDS["camera"]) as load:
        scorer = load("skymosaic_scores").Scorer(bench)
        found = scorer.score(homographies)
    np.testing.assert_array_equal(found, answers(quantise(homographies), matches, FRAME))
    assert found["score"].argmax() == 1
    assert bench.asked == polls
    sent, received = bench.address(scorer._sent), bench.address(scorer._received)
    assert sent % PAGE_BYTES == received % PAGE_BYTES == 0
    assert received - sent >= scorer._sent.nbytes


def test_scores_that_do_not_come_end_the_wait(matches: Records) -> None:
    bench = Simulated(matches, 1 << 40)
    sent = np.zeros(HYPOTHESIS.record_bytes, np.uint8)
    with pytest.raises(TimeoutError, match="no scores in 5000000 clocks"):
        bench.exchange(sent, sent.nbytes, sent)
