# amaranth: UnusedElaboratable=no
"""Match records of whole sequences equal the golden model word for word.

It stands for tests of its parts, whose wrong lines it notices in samples: `feature_banks`, `hamming`,
`mutual_neighbours`, `nearest_neighbours`, `orientation_histogram` and `match_weigher`.
"""

from collections.abc import Iterator, Sequence
from itertools import starmap
from typing import Any

import numpy as np
import pytest
from amaranth.hdl import Fragment
from numpy.typing import NDArray

from bench.designs import largest_rules
from golden_model.config import Config, FrontEndConfig, MatcherConfig
from golden_model.feature.ilbp import ILBP_128, PATTERNS, DescriptorPattern
from golden_model.front_end import FrameFeatures
from golden_model.fuzzy.rules import MatchRules, read_shipped
from golden_model.matching.matcher import ReferenceFrame, match
from golden_model.records import FRAME_STATUS, MATCH, Cause, Tag
from hdl.matching.matcher import Matcher
from hdl.matching.nearest_neighbours import NearestNeighbours
from sim.backends.golden import add_matches
from sim.backends.interface import FrameResult, Reference
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench

ILBP_32 = PATTERNS["thesis-ilbp-4"]
LANES, MAX_FEATURES = 4, 16
CYCLE_LIMIT = 8000
ESTIMATE_CYCLES = 150
"""By then the next frame waits."""
FIRST_FRAME = 0x1_FFFE
"""Records name the lower half of the reference's number."""


def feature_dtypes(pattern: DescriptorPattern) -> tuple[np.dtype[np.void], np.dtype[np.void]]:
    record = pattern.record
    return record.dtype, FRAME_STATUS.dtype_padded_to(record.record_bytes)


def random_features(
    rng: np.random.Generator, number: int, pattern: DescriptorPattern, descriptors: NDArray[np.uint8] | None = None
) -> NDArray[np.void]:
    features = np.zeros(number, feature_dtypes(pattern)[0])
    features["tag"], features["index"], features["frame"] = Tag.FEATURE, np.arange(number), FIRST_FRAME
    features["x"], features["y"] = rng.integers(0, 1 << 16, (2, number))
    features["level"], features["response"] = rng.integers(0, 2, number), rng.integers(1, 1 << 15, number)
    features["descriptor"] = rng.integers(0, 256, (number, pattern.descriptor_bytes))
    if descriptors is not None:
        features["descriptor"] = descriptors[rng.integers(0, len(descriptors), number)]
    if pattern.oriented:
        features["sector"] = rng.integers(0, 16, number)
    if pattern.carries_window:
        features["window"] = rng.integers(0, 256, (number, 9))
    return features


def seen_again(
    rng: np.random.Generator, features: NDArray[np.void], number: int, pattern: DescriptorPattern
) -> NDArray[np.void]:
    """Some of the features in another order, rotated, and each with its own amount of noise."""
    again = features[rng.permutation(len(features))[:number]]
    again["index"] = np.arange(number)
    noise = rng.uniform(0, 0.4, (number, 1))
    again["descriptor"] ^= np.packbits(rng.random((number, pattern.bits)) < noise, axis=1)
    if pattern.oriented:
        again["sector"] = (again["sector"] + 5 + rng.choice([0, 0, 0, 1, 2, 3, 8], number)) % 16
    if pattern.carries_window:
        again["window"] = np.clip(again["window"] + rng.normal(0, rng.uniform(0, 30, (number, 1)), (number, 9)), 0, 255)
    return again


def frame_status(
    pattern: DescriptorPattern, number: int, features: NDArray[np.void], causes: int | Cause = 0
) -> NDArray[np.void]:
    status = np.zeros((), feature_dtypes(pattern)[1])
    status["tag"], status["good"], status["causes"] = Tag.FRAME_STATUS, not causes, causes
    status["frame"] = FIRST_FRAME + number
    status["features"] = 0 if causes else len(features)
    status["width"], status["height"], status["threshold"], status["cycles"] = 640, 480, 77, 1 << 20
    return status


def sequence(
    pattern: DescriptorPattern, sizes: tuple[Any, ...], bad: tuple[int, ...] = (), descriptors: Any = None
) -> list[tuple[NDArray[np.void], Any]]:
    """``(features, status)`` of frames; each frame sees the features of the one before again, if that has enough."""
    rng = np.random.default_rng(sizes)
    frames, features = [], random_features(rng, MAX_FEATURES, pattern, descriptors)
    for number, size in enumerate(sizes):
        fresh = random_features(rng, size, pattern, descriptors)
        features = seen_again(rng, features, size, pattern) if len(features) >= size else fresh
        features["frame"] = FIRST_FRAME + number
        frames.append((features, frame_status(pattern, number, features, Cause.LONG_LINE if number in bad else 0)))
    return frames


def packets_of(results: Iterator[Any]) -> Iterator[Any]:
    """Words of each frame's matches and status."""
    for matches, status in results:
        ending = np.zeros((), FRAME_STATUS.dtype_padded_to(MATCH.record_bytes))
        for name in FRAME_STATUS.dtype.names:
            ending[name] = status[name]
        yield np.frombuffer(matches.tobytes() + ending.tobytes(), np.uint64).tolist()


def expected_packets(
    frames: list[tuple[NDArray[np.void], Any]], pattern: DescriptorPattern, matcher: MatcherConfig, reference: Reference
) -> tuple[list[list[int]], list[FrameResult]]:
    config = Config(front_end=FrontEndConfig(descriptor=pattern.name, border_px=20), matcher=matcher)
    results = list(add_matches(starmap(FrameFeatures, frames), config, reference))
    return list(packets_of((result.matches, result.match_status) for result in results)), results


class MatcherBench:
    """Stream frames through a matcher, each with its settings.

    ``interrupted`` says how much of ``broken`` to send before each reset, from which on the frames come: a number of
    words, and clocks to wait after them.
    """

    def __init__(
        self,
        pattern: DescriptorPattern,
        config: MatcherConfig,
        frames: list[tuple[NDArray[np.void], Any]],
        settings: list[dict[str, Any]],
        *,
        pauses: Pauses = NO_PAUSES,
        broken: Sequence[tuple[NDArray[np.void], Any]] = (),
        interrupted: Sequence[tuple[int, int]] = ((0, 0),),
    ) -> None:
        self.dut = Matcher(config=config, pattern=pattern, lanes=LANES, max_features=MAX_FEATURES)
        self.bench = BlockBench(self.dut, pauses=pauses, cycle_limit=CYCLE_LIMIT)
        self.interrupted, self.frames = interrupted, len(frames)
        self.broken: list[Any] = []
        self.words: list[Any] = []
        for sent, each, values in (
            *((self.broken, frame, {}) for frame in broken),
            *((self.words, *both) for both in zip(frames, settings, strict=True)),
        ):
            *words, last = np.frombuffer(each[0].tobytes() + each[1].tobytes(), np.uint64).tolist()
            sent += [*(({"data": word, "last": 0}, {}) for word in words), ({"data": last, "last": 1}, values)]
        self.has_reset, self.cycle = False, 0
        self.packets: list[Any] = []
        self.ends: list[Any] = []
        self.taken: list[Any] = []

    def run(self) -> Any:
        """Run the simulation; returns the packets of words that leave after each reset."""
        self.bench.run(self.sink, background=[self.source, self.watch])
        return self.packets

    async def source(self, ctx: Any) -> None:
        for number, (words, wait_cycles) in enumerate(self.interrupted):
            while len(self.packets) < number * self.frames:
                await ctx.tick()
            self.has_reset = False
            await self.send(ctx, self.broken[:words])
            await ctx.tick().repeat(wait_cycles + 1)
            await self.bench.pulse(ctx, self.bench.reset)
            # A word that is taken in the clock of the reset still belongs to what came before it.
            await ctx.tick()
            self.has_reset = True
            await self.send(ctx, self.words)

    async def send(self, ctx: Any, words: Any) -> None:
        for payload, settings in words:
            for name, value in settings.items():
                ctx.set(getattr(self.dut, name), value)
            await self.bench.stream_put(ctx, self.dut.i_features, payload)

    async def watch(self, ctx: Any) -> None:
        async for *_, taken in ctx.tick().sample(self.dut.o_reference_taken):
            self.cycle += 1
            if taken and self.has_reset:
                self.taken.append(len(self.packets))

    async def sink(self, ctx: Any) -> None:
        words = []
        while len(self.packets) < self.frames * len(self.interrupted):
            payload = await self.bench.stream_get(ctx, self.dut.o_matches)
            if not self.has_reset:
                continue
            words.append(payload.data)
            if payload.last:
                self.packets.append(words)
                self.ends.append(self.cycle)
                words = []


def search_cycles(search: NearestNeighbours, left: int, right: int) -> int:
    """Clocks of a search through so many features."""
    if not left or not right:
        return 0
    return -(-left // search.lanes) * max(right, search.shortest_pass_cycles) + search.drain_cycles


def settings_for(
    frames: list[tuple[NDArray[np.void], Any]], config: MatcherConfig, reference: str
) -> list[dict[str, Any]]:
    return [{"i_hold_reference": reference == "held", "i_keep_above": config.keep_above}] * len(frames)


def assert_equal_to_golden(
    pattern: DescriptorPattern,
    config: MatcherConfig,
    frames: list[tuple[NDArray[np.void], Any]],
    reference: Reference,
    **bench: Any,
) -> Any:
    """Compare all packets; returns the golden results."""
    expected, results = expected_packets(frames, pattern, config, reference)
    assert MatcherBench(pattern, config, frames, settings_for(frames, config, reference), **bench).run() == expected
    return results


@pytest.mark.parametrize(
    ("reference", "pauses"), [("previous", NO_PAUSES), ("held", Pauses(gaps=60, stalls=150, seed=9))]
)
def test_records_of_a_sequence_equal_the_golden_model(reference: Reference, pauses: Pauses) -> None:
    """With full, empty and bad frames, and frames of one feature.

    Where nothing pauses, a frame takes left * right / lanes clocks, and a few for each match, feature and pass.
    """
    sizes, config = (13, 11, 10, 1, 1, 0, 16, 12), MatcherConfig()
    frames = sequence(ILBP_128, sizes, bad=(2,))
    expected, results = expected_packets(frames, ILBP_128, config, reference)
    bench = MatcherBench(ILBP_128, config, frames, settings_for(frames, config, reference), pauses=pauses)
    assert bench.run() == expected
    assert sum(len(result.matches) for result in results) > 20
    assert len({rule for result in results for rule in result.matches["rule"].tolist()}) > 4
    if pauses is NO_PAUSES:
        search = NearestNeighbours(bits=ILBP_128.bits, lanes=LANES, max_features=MAX_FEATURES)
        Fragment.get(search, None)  # otherwise Amaranth warns that its parts are unused
        # Of those that need not wait for their features; a bad frame is no reference.
        for number, left in ((1, 13), (3, 11), (4, 1), (7, 16)):
            right = sizes[number]
            cycles = bench.ends[number] - bench.ends[number - 1] - search_cycles(search, left, right)
            assert 0 < cycles <= 2 * left + 47 * len(results[number].matches) + 90


RULES: dict[str, tuple[DescriptorPattern, str | MatchRules]] = {
    "ilbp": (ILBP_32, "ilbp"),
    "none": (ILBP_32, "none"),
    "own over windows": (ILBP_32, MatchRules(read_shipped("ilbp").replace("yes Constant 1", "yes Constant 0.7"))),
    "ignored inputs": (
        ILBP_128,
        MatchRules(read_shipped("aerial").replace(" and margin is small", "").replace("AlgebraicProduct", "Minimum")),
    ),
    "32 rules": (ILBP_128, largest_rules()),
    "product": (
        ILBP_128,
        MatchRules(
            read_shipped("aerial").replace("0.34", "0.27").replace("turned Constant 0.15", "turned Constant 0.5")
        ),
    ),
}


@pytest.mark.parametrize("name", RULES)
def test_records_of_other_rules_equal_the_golden_model(name: str) -> None:
    pattern, rules = RULES[name]
    config = MatcherConfig(rule_base=rules, keep_above=255 if rules == "none" else 127)
    pauses = Pauses(stalls=100 * (pattern is ILBP_32), seed=1)
    results = assert_equal_to_golden(pattern, config, sequence(pattern, (16, 13)), "previous", pauses=pauses)
    matches = results[1].matches
    assert len(matches) > 7
    assert len(set(matches["verdict"])) == (1 if rules == "none" else 2)
    assert len(set(matches["weight"])) >= (7 if pattern is ILBP_128 else 1)


@pytest.mark.parametrize("different", [2, 5])
def test_equal_distances_are_resolved_as_in_the_golden_model(different: int) -> None:
    """Few different descriptors, so that most distances are equal; with 2 they are 0 or all bits."""
    descriptors = np.random.default_rng(7).integers(0, 256, (different, 4), dtype=np.uint8)
    if different == 2:
        descriptors[1] = ~descriptors[0]
    rng = np.random.default_rng(different)
    found = [random_features(rng, size, ILBP_32, descriptors) for size in (16, 16, 5, 1, 1)]
    frames = [(features, frame_status(ILBP_32, 0, features)) for features in found]
    results = assert_equal_to_golden(ILBP_32, MatcherConfig(), frames, "previous")
    assert all(len(result.matches) > 0 for result in results[1:])


def test_a_taken_reference_replaces_the_old_one() -> None:
    frames = sequence(ILBP_32, (7, 8, 7, 8, 7, 8))
    config = MatcherConfig()
    taken = [0, 0, 1, 0, 0, 0]
    settings = settings_for(frames, config, "held")
    settings = [{**values, "i_take_reference": take} for values, take in zip(settings, taken, strict=True)]
    bench = MatcherBench(ILBP_32, config, frames, settings)
    # The third frame becomes the reference, as if a new run began with it.
    before, _ = expected_packets(frames[:2], ILBP_32, config, "held")
    after, _ = expected_packets(frames[2:], ILBP_32, config, "held")
    assert bench.run() == before + after
    assert len(bench.taken) == 1


def test_a_refused_frame_does_not_become_the_reference() -> None:
    """Known once the next frame waits to be taken."""
    frames, config = sequence(ILBP_32, (7, 8, 7, 8, 7)), MatcherConfig()
    refused = [1, 0, 1, 1, 0]
    bench = MatcherBench(ILBP_32, config, frames, settings_for(frames, config, "previous"))

    async def estimate(ctx: Any) -> None:
        for cause in refused:
            words = 0
            while words == 0 or not ctx.get(bench.dut.o_matches.payload.last):
                await ctx.tick()
                words += ctx.get(bench.dut.o_matches.valid)
            ctx.set(bench.dut.i_estimating, 1)
            ctx.set(bench.dut.i_refused, 1 - cause)
            for _ in range(ESTIMATE_CYCLES):
                await ctx.tick()
                assert not ctx.get(bench.dut.o_frame_taken)
            ctx.set(bench.dut.i_estimating, 0)
            ctx.set(bench.dut.i_refused, cause)
            await ctx.tick()

    bench.bench.run(bench.sink, background=[bench.source, bench.watch, estimate])
    references: ReferenceFrame[Any] = ReferenceFrame()
    for (features, _), cause, packet in zip(frames, refused, bench.packets, strict=True):
        left = references.for_frame(features, good=True, held=False)
        wanted = np.zeros(0, MATCH.dtype) if left is None else match(left, features, ILBP_32, config)
        assert np.array(packet[:-3], np.uint64).tobytes() == wanted.tobytes()
        references.judge(accepted=not cause)


def test_reset_in_any_phase_leaves_nothing_behind() -> None:
    """In a record, a frame, the search, the count of the turns, the search for their peak, the sending of a match."""
    config, broken, frames = MatcherConfig(), sequence(ILBP_128, (12, 11)), sequence(ILBP_128, (6, 5))
    interrupted = (2, 0), (75, 0), (100, 5), (100, 50), (100, 275), (100, 354)
    expected, _ = expected_packets(frames, ILBP_128, config, "previous")
    settings = settings_for(frames, config, "previous")
    bench = MatcherBench(ILBP_128, config, frames, settings, broken=broken, interrupted=interrupted)
    assert bench.run() == expected * len(interrupted)


@pytest.mark.usefixtures("unused_blocks")
def test_columns_that_come_after_their_distance_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdl.matching.nearest_neighbours.COLUMN_CYCLES", 9)
    with pytest.raises(ValueError, match="columns take 9 clocks, but the path that they meet only 7"):
        NearestNeighbours(bits=8, lanes=2, max_features=8)
