"""Roles, contents and counts of the feature banks after each frame."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.feature.ilbp import PATTERNS, DescriptorPattern
from golden_model.records import FRAME_STATUS, Tag
from hdl.matching.feature_banks import READ_CYCLES, FeatureBanks
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench

MAX_FEATURES = 16


def random_frames(rng: np.random.Generator, sizes: list[int], pattern: DescriptorPattern) -> Iterator[Any]:
    """Records of each frame's features."""
    record = pattern.record
    for size in sizes:
        features = np.frombuffer(rng.bytes(size * record.record_bytes), record.dtype).copy()
        features["tag"], features["index"] = Tag.FEATURE, np.arange(size)
        features["sector"] = rng.integers(0, 16, size)
        yield features


def status_of(features: Any, good: Any) -> Any:
    status = np.zeros(1, FRAME_STATUS.dtype_padded_to(features.dtype.itemsize))
    status["tag"], status["good"], status["features"] = Tag.FRAME_STATUS, good, len(features)
    return status


class BanksBench:
    """Send frames, take the status of each, and read both sides back while the next frame arrives."""

    def __init__(
        self, pattern: DescriptorPattern, frames: list[tuple[NDArray[np.void], int, tuple[int, int]]], pauses: Pauses
    ) -> None:
        self.dut = FeatureBanks(pattern=pattern, max_features=MAX_FEATURES)
        self.bench = BlockBench(self.dut, pauses=pauses)
        self.pattern, self.frames = pattern, frames
        self.sides: list[Any] = []

    def run(self) -> Any:
        self.bench.run(self.sink, background=[self.source])
        return self.sides

    async def source(self, ctx: Any) -> None:
        for features, good, _ in self.frames:
            for word in np.frombuffer(features.tobytes() + status_of(features, good).tobytes(), np.uint64).tolist():
                await self.bench.stream_put(ctx, self.dut.i, {"data": word, "last": 0})

    async def sink(self, ctx: Any) -> None:
        dut = self.dut
        for _, good, (hold, take) in self.frames:
            ctx.set(dut.i_hold_reference, hold)
            ctx.set(dut.i_take_reference, take)
            status = await self.bench.stream_get(ctx, dut.o_status)
            assert status.good == good
            self.sides.append([await self.side(ctx, side) for side in ("left", "right")])

    async def side(self, ctx: Any, side: Any) -> Any:
        address, count = getattr(self.dut, f"i_{side}_address"), getattr(self.dut, f"o_{side}_count")
        feature = getattr(self.dut, f"o_{side}")
        features = []
        for n in range(ctx.get(count)):
            ctx.set(address, n)
            await ctx.tick().repeat(READ_CYCLES)
            features.append({name: ctx.get(feature[name]) for name, _ in feature.shape()})
        return features


def contents(features: Any, pattern: Any) -> Any:
    """The entries that the banks should hold for the frame."""
    result = []
    for feature in features:
        entry = {"x": int(feature["x"]), "y": int(feature["y"]), "sector": 0, "window": 0}
        entry["descriptor"] = int.from_bytes(feature["descriptor"].tobytes(), "little")
        if pattern.oriented:
            entry["sector"] = int(feature["sector"])
        if pattern.carries_window:
            entry["window"] = int.from_bytes(feature["window"].tobytes(), "little")
        result.append(entry)
    return result


PREVIOUS, HELD, TAKE = (0, 0), (1, 0), (0, 1)


@pytest.mark.parametrize(("name", "pauses"), [("ilbp-128", NO_PAUSES), ("thesis-ilbp-2", Pauses(gaps=120, seed=4))])
def test_each_frame_takes_the_role_that_its_status_and_settings_give(name: str, pauses: Pauses) -> None:
    """The table says for each frame which frames are left and right after it."""
    pattern = PATTERNS[name]
    steps = [
        # features, good, settings, left, right
        (5, 0, PREVIOUS, None, None),
        (16, 1, PREVIOUS, 1, None),
        (7, 1, PREVIOUS, 1, 2),
        (9, 0, PREVIOUS, 1, 2),
        (16, 1, PREVIOUS, 2, 4),
        (0, 1, PREVIOUS, 4, 5),
        (3, 1, HELD, 4, 6),
        (1, 1, HELD, 4, 7),
        (12, 1, PREVIOUS, 7, 8),
        (16, 1, TAKE, 9, None),
        (11, 0, TAKE, 9, None),
        (2, 1, HELD, 9, 11),
        (13, 1, (1, 1), 12, None),
        (15, 1, PREVIOUS, 12, 13),
    ]
    frames = list(random_frames(np.random.default_rng(6), [size for size, *_ in steps], pattern))
    bench = BanksBench(pattern, [(f, good, how) for f, (_, good, how, *_) in zip(frames, steps, strict=True)], pauses)
    for number, (sides, (*_, left, right)) in enumerate(zip(bench.run(), steps, strict=True)):
        for actual, frame in zip(sides, (left, right), strict=True):
            expected = [] if frame is None else contents(frames[frame], pattern)
            assert actual == expected, f"after frame {number}"
