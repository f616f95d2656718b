# amaranth: UnusedElaboratable=no
"""Features leave in the golden model's order with their indices, and a status ends each frame."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.feature.ilbp import ILBP_128
from golden_model.records import FRAME_STATUS, Cause, Tag
from golden_model.selection.selection import emission_order
from hdl.level_merge import LevelMerge
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench

RECORD = ILBP_128.record
MAX_FEATURES = 12
SIZE_PX = (640, 480)


def frame(*levels: list[Any]) -> list[Any]:
    """Features of a frame; each level is given as the number of features of its cell rows."""
    features = [[np.zeros(count, RECORD.dtype) for count in rows] for rows in levels]
    for level, rows in enumerate(features):
        for row, records in enumerate(rows):
            records["tag"], records["level"], records["response"] = Tag.FEATURE, level, row
            records["x"] = np.arange(len(records))
    return features


def expected(frames: Any, causes: Any) -> Any:
    packets = []
    for number, (levels, geometry_cause) in enumerate(zip(frames, causes, strict=True)):
        records = np.concatenate([records for rows in levels for records in rows] or [np.zeros(0, RECORD.dtype)])
        records = records[emission_order(records["level"], records["response"])]
        cause = geometry_cause | (Cause.TOO_MANY_FEATURES if len(records) > MAX_FEATURES else 0)
        records = records[:MAX_FEATURES]
        records["index"], records["frame"] = np.arange(len(records)), number
        status = np.zeros((), FRAME_STATUS.dtype_padded_to(RECORD.record_bytes))
        status["tag"], status["good"], status["causes"], status["frame"] = Tag.FRAME_STATUS, not cause, cause, number
        status["width"], status["height"] = SIZE_PX
        status["threshold"], status["features"] = 100 + number, 0 if cause else len(records)
        packets.append((records, status))
    return packets


class MergeBench:
    """Stream frames through a merge; the pixels of a frame take 40 clocks, and its features come after its start."""

    def __init__(self, frames: list[Any], causes: list[Cause], pauses: Pauses) -> None:
        self.dut = LevelMerge(record=RECORD, levels=len(frames[0]), max_features=MAX_FEATURES)
        self.bench = BlockBench(self.dut, pauses=pauses, cycle_limit=3000)
        self.frames, self.causes = frames, causes
        self.started: list[Any] = []
        self.packets: list[Any] = []

    def run(self) -> Any:
        self.bench.run(*map(self.source, range(self.dut.levels)), self.pixels, self.sink)
        return [_decoded(packet) for packet in self.packets]

    def source(self, level: int) -> Callable[..., Any]:
        async def testbench(ctx: Any) -> None:
            for number, payload in self._payloads(level):
                while number not in self.started:
                    await ctx.tick()
                await self.bench.stream_put(ctx, self.dut.i_levels[level], payload)

        return testbench

    def _payloads(self, level: Any) -> Iterator[Any]:
        for number, (levels, cause) in enumerate(zip(self.frames, self.causes, strict=True)):
            for row, records in enumerate(levels[level]) if cause != Cause.MISSING_START else ():
                for word in np.frombuffer(records.tobytes(), np.uint64).tolist():
                    yield number, {"data": word, "ends_row": 0, "ends_level": 0}
                yield number, {"data": 0, "ends_row": 1, "ends_level": row == len(levels[level]) - 1}

    async def pixels(self, ctx: Any) -> None:
        dut = self.dut
        ctx.set(dut.i_settings.width_px, SIZE_PX[0])
        ctx.set(dut.i_settings.height_px, SIZE_PX[1])
        for number, cause in enumerate(self.causes):
            ctx.set(dut.i_starts, cause != Cause.MISSING_START)
            await ctx.tick()
            ctx.set(dut.i_starts, 0)
            self.started.append(number)
            await ctx.tick().repeat(40)
            await self.bench.wait_until_low(ctx, dut.o_pending)
            ctx.set(dut.i_causes, cause)
            ctx.set(dut.i_threshold_code, 100 + number)
            await self.bench.pulse(ctx, dut.i_ends)

    async def sink(self, ctx: Any) -> None:
        words = []
        while len(self.packets) < len(self.frames):
            payload = await self.bench.stream_get(ctx, self.dut.o)
            words.append(payload.data)
            if payload.last:
                self.packets.append(np.array(words, np.uint64))
                words = []


def _decoded(packet: Any) -> Any:
    data = packet.tobytes()
    features = np.frombuffer(data[: -RECORD.record_bytes], RECORD.dtype)
    return features, np.frombuffer(data[-RECORD.record_bytes :], FRAME_STATUS.dtype_padded_to(RECORD.record_bytes))[0]


CASES = {
    "two_levels": [frame([1, 2, 0, 1], [2, 1]), frame([0, 0, 3], [0, 0]), frame([3, 3, 2], [1, 3])],
    "level_1_shorter": [frame([1, 1, 1, 1, 1], [2]), frame([1], [1])],
    "one_level": [frame([3]), frame([0]), frame([5])],
    # Of the first frame, the very last feature is the one too many.
    "too_many": [frame([5, 5], [3]), frame([5, 5], [2]), frame([5, 5, 5, 5], [4])],
}


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=80, stalls=120, seed=5)], ids=["free", "pauses"])
@pytest.mark.parametrize("frames", CASES.values(), ids=CASES)
def test_features_are_ordered_and_indexed_and_a_status_ends_each_frame(
    frames: list[list[list[NDArray[np.void]]]], pauses: Pauses
) -> None:
    causes = [Cause(0)] * len(frames)
    for (features, status), (wanted, wanted_status) in zip(
        MergeBench(frames, causes, pauses).run(), expected(frames, causes), strict=True
    ):
        np.testing.assert_array_equal(features, wanted)
        assert status["cycles"] >= 40
        for name in set(status.dtype.names) - {"cycles"}:
            assert status[name] == wanted_status[name], name


def test_a_frame_without_start_has_a_status_and_no_features() -> None:
    frames = [frame([2], [1]), frame([], []), frame([1, 1], [1])]
    causes = [Cause(0), Cause.MISSING_START, Cause.SHORT_LINE]
    packets = MergeBench(frames, causes, NO_PAUSES).run()
    assert [len(features) for features, _ in packets] == [3, 0, 3]
    assert [int(status["good"]) for _, status in packets] == [1, 0, 0]
    assert [Cause(int(status["causes"])) for _, status in packets] == causes
    assert [int(status["features"]) for _, status in packets] == [3, 0, 0]
    assert packets[1][1]["cycles"] == 0
