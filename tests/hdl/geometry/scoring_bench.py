"""Scores hypotheses in Amaranth's simulator, with the signature of `golden_model.geometry.scoring.score`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.geometry.scoring import MAX_MATCHES, Scores
from hdl.geometry.match_gain import PAIR
from hdl.geometry.scoring import HomographyScoring
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench


def simulate_scoring(
    hypotheses: NDArray[np.integer],
    left: NDArray[np.integer],
    right: NDArray[np.integer],
    weight: NDArray[np.integer],
    *,
    max_matches: int = MAX_MATCHES,
    pauses: Pauses = NO_PAUSES,
) -> Scores:
    """Send a set of matches and all hypotheses through `hdl.geometry.scoring.HomographyScoring`.

    Parameters and result as in `golden_model.geometry.scoring.score`. It simulates a few thousand clocks per second;
    with N matches a hypothesis takes N clocks.

    Raises
    ------
    AssertionError
        If the block breaks the stream rules, or is slower than it says.
    """
    dut = HomographyScoring(max_matches=max_matches)
    cycles = len(weight) + 1 + len(hypotheses) * (len(weight) + dut.latency_cycles)
    # A stream that pauses in p of 256 clocks takes 256 / (256 - p) as long.
    slower = 256 // (256 - max(pauses.gaps, pauses.stalls)) + 1
    bench = BlockBench(dut, pauses=pauses, cycle_limit=4 * slower * cycles + 100)
    received = []

    async def send(ctx: Any) -> None:
        # One after the other: a hypothesis that comes before the first match is scored without matches.
        for payload in set_of_matches(left, right, weight):
            await bench.stream_put(ctx, dut.i_matches, payload)
        for hypothesis in hypothesis_payloads(hypotheses):
            await bench.stream_put(ctx, dut.i_hypotheses, hypothesis)

    async def receive(ctx: Any) -> None:
        for _ in hypotheses:
            answer = await bench.stream_get(ctx, dut.o)
            received.append((answer.score, answer.support, answer.causes))

    bench.run(send, receive)
    return Scores(*np.array(received, dtype=np.int64).reshape(-1, 3).T)


async def time_scores(ctx: Any, dut: HomographyScoring, hypotheses: NDArray[np.integer]) -> list[tuple[int, Any]]:
    """Offer hypotheses to the idle block without a pause; return each score with the clock in which it comes.

    The first hypothesis is offered in clock 0. Scores are taken at once.
    """
    scores: list[tuple[int, Any]] = []
    payloads = hypothesis_payloads(hypotheses)
    taken = clock = 0
    ctx.set(dut.o.ready, 1)
    while len(scores) < len(hypotheses):
        ctx.set(dut.i_hypotheses.valid, taken < len(hypotheses))
        ctx.set(dut.i_hypotheses.payload, payloads[min(taken, len(payloads) - 1)])
        if ctx.get(dut.o.valid):
            scores.append((clock, ctx.get(dut.o.payload)))
        *_, was_taken = await ctx.tick().sample(dut.i_hypotheses.valid & dut.i_hypotheses.ready)
        taken += was_taken
        clock += 1
    await ctx.tick()
    return scores


def set_of_matches(
    left: NDArray[np.integer], right: NDArray[np.integer], weight: NDArray[np.integer], frame: int = 0
) -> list[dict[str, Any]]:
    """Make the payloads of ``i_matches`` for the set of a frame: positions (N, 2) in 1/16 px, and weights (N,)."""
    names = tuple(PAIR.members)
    rows = np.hstack((left, right, weight[:, np.newaxis])).tolist()
    sent = [
        {"match": {"pair": dict(zip(names, row, strict=False)), "weight": row[-1]}, "ends": 0, "frame": 0}
        for row in rows
    ]
    # What comes with the end is no match and does not count.
    return [*sent, {"match": {"pair": dict.fromkeys(names, 0), "weight": 0}, "ends": 1, "frame": frame}]


def hypothesis_payloads(hypotheses: NDArray[np.integer]) -> list[dict[str, Any]]:
    """Make the payloads of ``i_hypotheses`` for hypotheses (M, 3, 3), numbered from 0; the last one is marked."""
    return [
        {"elements": elements, "number": number, "last": number == len(hypotheses) - 1, "invalid": 0}
        for number, elements in enumerate(hypotheses.reshape(-1, 9).tolist())
    ]
