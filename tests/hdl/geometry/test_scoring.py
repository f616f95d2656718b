# amaranth: UnusedElaboratable=no
"""The scoring block equals the golden model, and takes exactly the clocks that are predicted."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.geometry import scoring as golden
from golden_model.geometry.scoring import ScoreCause, Scores, finish_cycles, score
from hdl.geometry.scoring import IN_FLIGHT, HomographyScoring
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.drivers import run_streams
from tests.hdl.geometry.scoring_bench import (
    extreme_hypotheses,
    hypothesis_payloads,
    matches,
    near_truth,
    set_of_matches,
    simulate_scoring,
    time_scores,
)

PAUSES = Pauses(gaps=120, stalls=150, seed=7)


async def answer(ctx: Any, bench: BlockBench, hypothesis: NDArray[np.int64]) -> Any:
    """Score, support and causes of one hypothesis."""
    await bench.stream_put(ctx, bench.dut.i_hypotheses, hypothesis_payloads(hypothesis[np.newaxis])[0])
    payload = await bench.stream_get(ctx, bench.dut.o)
    return payload.score, payload.support, payload.causes


def assert_equal(results: Scores, expected: Scores) -> None:
    for name in ("score", "support", "causes"):
        np.testing.assert_array_equal(getattr(results, name), getattr(expected, name), err_msg=name)


@pytest.mark.parametrize("pauses", [NO_PAUSES, PAUSES], ids=["free", "pauses"])
def test_scores_equal_the_golden_model(pauses: Pauses) -> None:
    left, right, weight = matches(30)
    hypotheses = near_truth(9)
    expected = score(hypotheses, left, right, weight)
    assert len(set(expected.score)) == len(hypotheses)
    assert_equal(simulate_scoring(hypotheses, left, right, weight, max_matches=30, pauses=pauses), expected)


def test_what_has_no_score_has_its_cause() -> None:
    """Elements just within the range and just beyond it; the smallest that are large enough, and smaller ones."""
    hypotheses, given = extreme_hypotheses(), matches(4)
    expected = score(hypotheses, *given)
    assert {0, ScoreCause.OUT_OF_RANGE, ScoreCause.NOT_NORMALISED} == set(expected.causes)
    assert_equal(simulate_scoring(hypotheses, *given, max_matches=4), expected)


def test_hypotheses_wait_for_a_set_that_begins_with_them() -> None:
    given, hypotheses = matches(5), near_truth(2)
    inputs = {"i_matches": set_of_matches(*given), "i_hypotheses": hypothesis_payloads(hypotheses)}
    results = run_streams(HomographyScoring(max_matches=8), inputs, {"o": 2})["o"]
    assert [each.score for each in results] == score(hypotheses, *given).score.tolist()
    assert [(each.number, each.last) for each in results] == [(0, 0), (1, 1)]


def test_sets_follow_each_other_without_a_trace() -> None:
    """Of one match, too many, none, and a full memory; each is answered as if it were the first."""
    dut = HomographyScoring(max_matches=12)
    hypotheses = near_truth(3)
    counts = (5, 13, 0, 12, 1, 2)
    sets = [matches(count, seed) for seed, count in enumerate(counts)]
    results: list[Any] = []

    async def run(ctx: Any) -> None:
        results.append([await answer(ctx, bench, h) for h in hypotheses])
        for given in sets:
            for payload in set_of_matches(*given):
                await bench.stream_put(ctx, dut.i_matches, payload)
            results.append([await answer(ctx, bench, h) for h in hypotheses])

    bench = BlockBench(dut, cycle_limit=2000, pauses=Pauses(gaps=60, stalls=60, seed=2))
    bench.run(run)
    empty = [array[:0] for array in sets[0]]
    for given, answers in zip([empty, *sets], results, strict=True):
        expected = score(hypotheses, *given, max_matches=12)
        assert_equal(golden.Scores(*np.array(answers).T), expected)


def test_every_score_comes_in_the_predicted_clock() -> None:
    """With so many matches that hypotheses overlap, just so many, and with few, one and none."""
    dut = HomographyScoring(max_matches=64)
    counts, hypotheses = (40, 25, 24, 7, 1, 0), 6
    results: list[Any] = []

    async def run(ctx: Any) -> None:
        for count in counts:
            for payload in set_of_matches(*matches(count)):
                await bench.stream_put(ctx, dut.i_matches, payload)
            scores = await time_scores(ctx, dut, near_truth(hypotheses))
            results.append([clock for clock, _ in scores])

    bench = BlockBench(dut, cycle_limit=2000)
    bench.run(run)
    assert results == [finish_cycles(count, hypotheses).tolist() for count in counts]


def test_the_model_of_time_knows_the_block() -> None:
    dut = HomographyScoring(max_matches=8)
    assert (dut.latency_cycles, IN_FLIGHT) == (golden.LATENCY_CYCLES, golden.IN_FLIGHT)


def test_reset_in_any_phase_leaves_nothing_behind() -> None:
    """While a set is loaded or read, or scores are on their way or wait; afterwards there is no set."""
    dut = HomographyScoring(max_matches=16)
    given, hypotheses = matches(9), near_truth(3)
    phases = (1, 9, 11, 13, 33, 46)
    results: list[Any] = []

    async def run(ctx: Any) -> None:
        for phase in phases:
            await disturb(ctx, phase)
            await bench.pulse(ctx, bench.reset)
            results.append(await answers(ctx))
            for payload in set_of_matches(*given):
                await bench.stream_put(ctx, dut.i_matches, payload)
            results.append(await answers(ctx))

    async def disturb(ctx: Any, phase: Any) -> None:
        await bench.pulse(ctx, bench.reset)
        sent = set_of_matches(*matches(9, seed=5))
        ctx.set(dut.i_hypotheses.payload, hypothesis_payloads(hypotheses)[0])
        ctx.set(dut.i_hypotheses.valid, 1)
        for clock in range(phase):
            ctx.set(dut.i_matches.payload, sent[min(clock, len(sent) - 1)])
            ctx.set(dut.i_matches.valid, clock < len(sent))
            await ctx.tick()
        ctx.set(dut.i_matches.valid, 0)
        ctx.set(dut.i_hypotheses.valid, 0)

    async def answers(ctx: Any) -> Any:
        return [await answer(ctx, bench, hypothesis) for hypothesis in hypotheses]

    bench = BlockBench(dut, cycle_limit=5000)
    bench.run(run)
    empty = [array[:0] for array in given]
    for matches_of, answered in zip((empty, given) * len(phases), results, strict=True):
        assert_equal(golden.Scores(*np.array(answered).T), score(hypotheses, *matches_of))


@pytest.mark.parametrize("max_matches", [0, golden.MAX_MATCHES + 1])
def test_an_impossible_memory_is_refused(max_matches: int) -> None:
    with pytest.raises(ValueError, match=f"max_matches is {max_matches}; it must be a whole number from 1 to 2048"):
        HomographyScoring(max_matches=max_matches)
