# amaranth: UnusedElaboratable=no
"""The estimator behind records: packets in, packets out; whatever is broken ends a frame that is not good."""

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.config import EstimatorConfig
from golden_model.geometry import estimator
from golden_model.geometry.estimator import FrameMatches, estimate, homography_record
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, Tag
from hdl.blocks.vectors import packet, padded_status
from hdl.geometry.records import KeptMatches, RecordEstimator
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench

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


def test_kept_matches_are_those_of_whole_packets() -> None:
    """Behind each packet that is broken the next one is whole, and only its frame is good."""
    records = match_records()
    # Where the status is cut after its first word, this stands where the tag and the mark of a good one would be.
    records["left_x"][-1] = Tag.FRAME_STATUS | 1 << 8
    good, unknown = packet(records, status(frame=5)), match_records()
    unknown["tag"][4] = Tag.FEATURE
    cut = [*good[:-CUT_WORDS], {**good[-CUT_WORDS], "last": 1}]
    broken = [
        packet(records, status(good=0)),
        packet(records),
        packet(unknown, status()),
        packet(match_records(5), status(), status()),
        cut,
        cut[-1:],
    ]
    kept = records[records["verdict"] == 1]
    packets = [words for each in broken for words in (good, each)]
    dut = KeptMatches()
    bench = BlockBench(dut, pauses=Pauses(gaps=80, stalls=120, seed=3), cycle_limit=20_000)
    received: list[Any] = []

    async def send(ctx: Any) -> None:
        for word in itertools.chain(*packets):
            await bench.stream_put(ctx, dut.i, word)

    async def receive(ctx: Any) -> None:
        while sum(each.ends for each in received) < len(packets):
            received.append(await bench.stream_get(ctx, dut.o))

    bench.run(send, receive)
    frames: list[list[Any]] = [[]]
    for each in received:
        frames[-1].append(each)
        if each.ends:
            frames.append([])
    assert not frames.pop()
    assert [bool(frame[-1].frame.good) for frame in frames] == [True, False] * len(broken)
    for frame in frames[::2]:
        assert (frame[-1].frame.frame, frame[-1].frame.reference) == (5, 2)
        assert [each.match.weight for each in frame[:-1]] == kept["weight"].tolist()
        for name in ("left_x", "left_y", "right_x", "right_y"):
            assert [each.match.pair[name] for each in frame[:-1]] == kept[name].tolist()


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
