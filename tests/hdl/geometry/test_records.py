# amaranth: UnusedElaboratable=no
"""Scoring behind records: packets in, packets out; whatever is broken is answered, and never with a score."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import EstimatorConfig
from golden_model.geometry import estimator
from golden_model.geometry.estimator import FrameMatches, estimate, homography_record
from golden_model.geometry.scoring import ScoreCause, hypothesis_records, quantise
from golden_model.geometry.scoring import answers as golden_answers
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, SCORE, Tag
from hdl.blocks.vectors import packet, padded_status
from hdl.geometry.records import RecordEstimator, RecordScoring
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.drivers import run_streams

HYPOTHESES = quantise(np.eye(3) + np.random.default_rng(1).normal(size=(3, 3, 3)) * 1e-4)
# Where the second record is cut after three words, this byte stands where its tag would be.
HYPOTHESES[0, 1, 2] = HYPOTHESES[0, 1, 2] & ~0xFF | Tag.HYPOTHESIS
CUT_WORDS = 3


def match_records(count: int = 20, seed: int = 2) -> NDArray[np.void]:
    """Matches near the identity, a third of them rejected."""
    rng = np.random.default_rng(seed)
    records = np.zeros(count, MATCH.dtype)
    left = rng.integers(0, 5000, (count, 2))
    right = np.abs(left + rng.integers(-50, 51, (count, 2)))
    records["tag"], records["weight"] = Tag.MATCH, rng.integers(1, 256, count)
    records["reference"] = seed
    records["verdict"] = rng.random(count) < 2 / 3
    records["left_x"], records["left_y"] = left.T
    records["right_x"], records["right_y"] = right.T
    return records


def status(good: int = 1, frame: int = 0) -> NDArray[np.void]:
    record: Any = np.zeros((), FRAME_STATUS.dtype)
    record["tag"], record["good"], record["frame"] = Tag.FRAME_STATUS, good, frame
    return padded_status(record, MATCH.record_bytes)


def expected(records: NDArray[np.void], frame: int = 0) -> list[dict[str, int]]:
    """The words of the scores by the kept ones of the matches."""
    return packet(golden_answers(HYPOTHESES, records, frame))


def refused(cause: ScoreCause, frame: int = 0) -> list[dict[str, int]]:
    records = golden_answers(HYPOTHESES, np.zeros(0, MATCH.dtype), frame)
    records["score"], records["support"], records["causes"] = 0, 0, cause
    return packet(records)


def answers(
    steps: list[tuple[str, list[dict[Any, Any]]]], *, max_matches: int = 32, pauses: Pauses = NO_PAUSES
) -> list[dict[str, int]]:
    """For each step, a port and the words to send to it, after the answers to the step before: all that came back."""
    dut = RecordScoring(max_matches=max_matches)
    bench = BlockBench(dut, pauses=pauses, cycle_limit=20_000)
    received: list[Any] = []

    async def send(ctx: Any) -> None:
        for port, words in steps:
            before = len(received)
            for word in words:
                await bench.stream_put(ctx, getattr(dut, port), word)
            while port == "i_hypotheses" and not any(word["last"] for word in received[before:]):
                await ctx.tick()

    async def receive(ctx: Any) -> None:
        while True:
            word = await bench.stream_get(ctx, dut.o)
            received.append({"data": word.data, "last": word.last})

    bench.run(send, background=(receive,))
    return received


def test_kept_matches_score_every_hypothesis() -> None:
    """Before any set, by one, and by the next."""
    pauses = Pauses(gaps=80, stalls=120, seed=3)
    asked = ("i_hypotheses", packet(hypothesis_records(HYPOTHESES)))
    first, second = match_records(), match_records(7, seed=9)
    sets = [("i_matches", packet(records, status(frame=n))) for records, n in ((first, 5), (second, 1 << 31))]
    received = answers([asked, sets[0], asked, sets[1], asked], pauses=pauses)
    assert received == refused(ScoreCause.NO_MATCHES) + expected(first, 5) + expected(second, 1 << 31)


def test_hypotheses_wait_for_a_packet_of_matches_that_is_under_way() -> None:
    records, words = match_records(), packet(hypothesis_records(HYPOTHESES))
    # The first kept match comes late, so that nothing is stored yet when the first hypothesis is complete.
    records["verdict"][:8] = 0
    dut = RecordScoring(max_matches=32)
    inputs = {"i_matches": packet(records, status(frame=3)), "i_hypotheses": words}
    received = run_streams(dut, inputs, {"o": 2 * len(HYPOTHESES)})["o"]
    assert [{"data": word.data, "last": word.last} for word in received] == expected(records, 3)


def test_a_bad_packet_of_matches_leaves_an_empty_set() -> None:
    good, asked = packet(match_records(), status()), ("i_hypotheses", packet(hypothesis_records(HYPOTHESES)))
    unknown = match_records()
    unknown["tag"][4] = Tag.FEATURE
    cut = [*good[:-CUT_WORDS], {**good[-CUT_WORDS], "last": 1}]
    broken = [
        packet(match_records(), status(good=0)),
        packet(match_records()),
        packet(unknown, status()),
        packet(match_records(5), status(), status()),
        cut,
        cut[-1:],
    ]
    steps = [step for words in broken for step in (("i_matches", good), asked, ("i_matches", words), asked)]
    wanted = (expected(match_records()) + refused(ScoreCause.NO_MATCHES)) * len(broken)
    assert answers([*steps, ("i_matches", good), asked]) == wanted + expected(match_records())


def test_a_broken_hypothesis_is_answered_and_the_next_packet_is_whole() -> None:
    words = packet(hypothesis_records(HYPOTHESES))
    wrong = hypothesis_records(HYPOTHESES)
    wrong["tag"][1] = Tag.MATCH
    cut = [*words[:7], {**words[7], "last": 1}]
    received = answers(
        [("i_matches", packet(match_records(), status())), ("i_hypotheses", cut), ("i_hypotheses", packet(wrong)),
         ("i_hypotheses", words)]
    )  # fmt: skip
    scores = expected(match_records())
    records = np.array([word["data"] for word in received], dtype=np.uint64).view(SCORE.dtype)
    assert records["causes"].tolist() == [0, ScoreCause.INVALID_RECORD, 0, ScoreCause.INVALID_RECORD, 0, 0, 0, 0]
    assert records["score"][[1, 3]].tolist() == [0, 0]
    assert received[3]["last"] == 1
    assert received[-len(scores) :] == scores


def test_a_memory_that_is_too_small_is_a_cause() -> None:
    records = match_records()
    small = int(np.count_nonzero(records["verdict"])) - 1
    steps = [("i_matches", packet(records, status())), ("i_hypotheses", packet(hypothesis_records(HYPOTHESES)))]
    assert answers(steps, max_matches=small) == refused(ScoreCause.TOO_MANY_MATCHES)
    assert answers(steps, max_matches=small + 1) == expected(records)


SETTINGS = EstimatorConfig(passes=1, min_inliers=5)


def estimates(packets: list[list[dict[str, int]]], *, reads: bool = True) -> tuple[NDArray[np.void], int, list[int]]:
    """Send packets to the estimator: the records that come back, how many are dropped, and ``o_refused`` with each.

    Without ``reads`` nothing is taken before all has been sent and computed.
    """
    dut = RecordEstimator(max_matches=32)
    bench = BlockBench(dut, settings={"i_settings": vars(SETTINGS), "i_enable": 1}, cycle_limit=60_000)
    received: list[Any] = []
    verdicts: list[int] = []
    drops = [0]

    async def send(ctx: Any) -> None:
        for words in packets:
            for word in words:
                await bench.stream_put(ctx, dut.i_matches, word)
        for _ in range(300 if not reads else 0):
            await ctx.tick()

    async def count(ctx: Any) -> None:
        while True:
            drops[0] += ctx.get(dut.o_drops)
            await ctx.tick()

    async def receive(ctx: Any) -> None:
        if not reads:
            await send(ctx)
        for _ in range(len(packets) if reads else 1):
            last = 0
            while not last:
                verdict = ctx.get(dut.o_refused)
                word = await bench.stream_get(ctx, dut.o)
                last = word.last
                received.append(word.data)
            verdicts.append(verdict)
        assert not ctx.get(dut.o_estimating)

    bench.run(*((send, receive) if reads else (receive,)), background=(count,))
    return np.array(received, dtype=np.uint64).view(HOMOGRAPHY.dtype), drops[0], verdicts


def test_every_packet_of_matches_is_answered_by_its_homography(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the first of the 16 steps of the search."""
    for module in ("golden_model.geometry.sampling", "hdl.geometry.estimator_states"):
        monkeypatch.setattr(f"{module}.STEPS", 1)
    matches, good = match_records(14), status(frame=7)
    good_view: Any = good.view(FRAME_STATUS.dtype_padded_to(MATCH.record_bytes))
    good_view["width"], good_view["height"] = 320, 240
    unknown = match_records()
    unknown["tag"][4] = Tag.FEATURE
    bad = [packet(matches, status(good=0, frame=1)), packet(matches), packet(unknown, status(frame=2))]
    few = packet(matches[:3], status(frame=9))
    records, drops, refused = estimates([few, *bad, packet(matches, good), bad[0], few, bad[0]])
    assert records["causes"].tolist()[1:4] == [estimator.EstimateCause.BAD_FRAME] * 3
    expected = estimate(FrameMatches.from_records(matches, good_view.reshape(1)[0]), SETTINGS)
    np.testing.assert_array_equal(records[4:5], homography_record(expected, frame=7, reference=2))
    assert records["score"][4] > 0
    assert (records["causes"][6], records["frame"][6]) == (estimator.EstimateCause.TOO_FEW_MATCHES, 9)
    assert drops == 0
    # Nothing is refused before one has been accepted. What is not a good frame leaves the last verdict as it is.
    assert (records["causes"][4], refused) == (0, [0, 0, 0, 0, 0, 0, 1, 1])


def test_a_record_that_is_not_wanted_is_not_lost() -> None:
    """Disabled, the output discards; a clear forgets matches, but completes the record that is offered."""
    dut = RecordEstimator(max_matches=32)
    bench = BlockBench(dut, settings={"i_settings": vars(SETTINGS)}, cycle_limit=60_000)
    few = [packet(match_records(3), status(frame=n)) for n in range(4)]
    received: list[int] = []

    async def send(ctx: Any, *words: dict[str, int]) -> None:
        for word in words:
            await bench.stream_put(ctx, dut.i_matches, word)
        for _ in range(100):
            assert not ctx.get(dut.o_drops)
            await ctx.tick()

    async def run(ctx: Any) -> None:
        await send(ctx, *few[0])
        assert not ctx.get(dut.o.valid)
        ctx.set(dut.i_enable, 1)
        await send(ctx, *few[1])
        received.append((await bench.stream_get(ctx, dut.o)).data)
        # In the middle of a record, and of a packet of matches.
        await send(ctx, *few[2][:4])
        assert ctx.get(dut.o_estimating)
        ctx.set(dut.i_clear, 1)
        await ctx.tick()
        ctx.set(dut.i_clear, 0)
        assert not ctx.get(dut.o_estimating)
        while len(received) < 8:
            received.append((await bench.stream_get(ctx, dut.o)).data)
        await send(ctx, *few[3])
        while len(received) < 16:
            received.append((await bench.stream_get(ctx, dut.o)).data)

    bench.run(run)
    records = np.array(received, dtype=np.uint64).view(HOMOGRAPHY.dtype)
    assert records["frame"].tolist() == [1, 3]
    assert records["causes"].tolist() == [estimator.EstimateCause.TOO_FEW_MATCHES] * 2


def test_a_host_that_does_not_read_stops_nothing() -> None:
    records, drops, _ = estimates([packet(match_records(3), status(frame=n)) for n in range(4)], reads=False)
    assert (records["frame"].tolist(), drops) == ([0], 3)
