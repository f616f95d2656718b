"""Hypotheses and matches with the extremes, and their scores in Amaranth's simulator."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import POSITION
from golden_model.geometry.scoring import ENTRY, MAX_MATCHES, Scores, quantise
from hdl.geometry.match_gain import PAIR
from hdl.geometry.scoring import HomographyScoring
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench

TRUTH = np.array([[1.02, 0.05, 30], [-0.04, 0.97, 10], [1e-5, 2e-5, 1]])


def matches(count: int, seed: int = 1) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Positions in 1/16 px, some near to where `TRUTH` maps them, some anywhere; and weights."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, 10_240, (count, 2))
    lifted = np.hstack((left / 16, np.ones((count, 1)))) @ TRUTH.T
    right = 16 * (lifted[:, :2] / lifted[:, 2:] + rng.normal(0, 2, (count, 2)))
    right = np.where(rng.random((count, 1)) < 0.3, rng.integers(0, 10_240, (count, 2)), right)
    return left, np.clip(np.rint(right), 0, POSITION.max_raw).astype(np.int64), rng.integers(0, 256, count)


def near_truth(count: int, seed: int = 2) -> NDArray[np.int64]:
    """Hypotheses that fit part of the matches."""
    spread = np.array([[1e-3, 1e-3, 1], [1e-3, 1e-3, 1], [2e-7, 2e-7, 2e-3]])
    return quantise(TRUTH + np.random.default_rng(seed).normal(size=(count, 3, 3)) * spread)


def extreme_hypotheses() -> NDArray[np.int64]:
    """Elements at both ends of the range, behind the camera, at the horizon, singular; and what has no score."""
    rng = np.random.default_rng(3)
    ends = rng.choice([ENTRY.min_raw, ENTRY.max_raw, 0], (10, 3, 3))
    anything = rng.integers(ENTRY.min_raw, ENTRY.max_raw + 1, (6, 3, 3))
    plain = near_truth(1)[0]
    horizon, mirrored, point = plain.copy(), -plain, np.zeros_like(plain)
    horizon[2] = (ENTRY.max_raw, ENTRY.min_raw, 0)
    point[:, 2] = (1 << 20, 1 << 19, ENTRY.max_raw)
    beyond = [plain.copy() for _ in range(3)]
    for h, value in zip(beyond, (1 << 24, -(1 << 24) - 1, (1 << 31) - 1), strict=True):
        h[1, 1] = value
    # The smallest elements that are large enough, and the largest that are not.
    limits = np.zeros((4, 3, 3), dtype=np.int64)
    limits[:, 0, 1] = (1 << 23, (1 << 23) - 1, -(1 << 23) - 1, -(1 << 23))
    return np.concatenate(
        (
            ends,
            anything,
            np.stack((quantise(np.eye(3)[np.newaxis])[0], plain, horizon, mirrored, point, *beyond, 0 * plain)),
            limits,
        )
    )


def extreme_matches() -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    corners = np.array([[0, 0], [POSITION.max_raw, 0], [0, POSITION.max_raw], [POSITION.max_raw] * 2])
    left, right = np.repeat(corners, 4, axis=0), np.tile(corners, (4, 1))
    # Under the identity, squared errors of 1, 4, 9 and 16 sixteenths of the tolerance: ties of every comparison.
    left[4:8], right[4:8] = 5000, 5000 + np.array([[12, 12], [-24, 24], [36, -36], [48, 48]])
    some = matches(14)
    weight = np.resize([255, 0, 1, 128], 16)
    return np.vstack((left, some[0])), np.vstack((right, some[1])), np.concatenate((weight, some[2]))


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
