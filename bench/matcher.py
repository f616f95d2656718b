"""Clocks of the matcher against F * F / lanes: from a frame's last word to its last match, simulated.

    python bench/matcher.py [--json FILE]

Both frames have F features and each has its partner, so that as many matches leave as can. They must equal the golden
model's. The overhead is what the search takes beyond F * F / lanes, and the two walks over the pairs after it: one for
the histogram of turns, one to weigh and send, four words a match.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from amaranth import Cat, ClockDomain, ClockSignal, Module, ResetSignal, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out
from rich.console import Console
from rich.table import Table

from golden_model.arrays import Records
from golden_model.config import MatcherConfig
from golden_model.feature.ilbp import PATTERNS, DescriptorPattern
from golden_model.feature.orientation import SECTORS
from golden_model.matching.matcher import match
from golden_model.records import FRAME_STATUS, MATCH, Tag, feature_record
from hdl.matching.matcher import Matcher
from sim.simulators import verilator
from sim.simulators.accelerator_designs import MATCHES, digest_sources
from sim.simulators.design import Design, Ports
from sim.simulators.recording import START_OF_FRAME, Segment

CONFIG = MatcherConfig()
DESCRIPTORS, LANES = ("ilbp-128", "ilbp-256"), (8, 16)
FEATURES = (256, 512, 1024, 1850, 2048)
"""The last but one is the most that a 640x480 frame can have."""
MAX_FEATURES = 2048
LARGEST_NOISE = 0.3
"""Share of a descriptor's bits that differ between partners."""
CLOCK_MHZ = 150


class MatcherTop(wiring.Component):
    """The matcher behind the ports of a simulation; its words come in two beats, the lower half first."""

    def __init__(self, matcher: Matcher) -> None:
        self.matcher = matcher
        super().__init__(
            {
                "aclk": In(1),
                "aresetn": In(1),
                "s_axis_video_tdata": In(32),
                "s_axis_video_tuser": In(1),
                "s_axis_video_tlast": In(1),
                "s_axis_video_tvalid": In(1),
                "s_axis_video_tready": Out(1),
                f"{MATCHES}_tdata": Out(64),
                f"{MATCHES}_tlast": Out(1),
                f"{MATCHES}_tvalid": Out(1),
                f"{MATCHES}_tready": In(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Two beats to a word."""
        m = Module()
        m.domains.sync = ClockDomain()
        m.submodules.matcher = matcher = self.matcher
        low, has_low = Signal(32), Signal()
        words, matches = matcher.i_features, matcher.o_matches
        m.d.comb += [
            ClockSignal().eq(self.aclk),
            ResetSignal().eq(~self.aresetn),
            words.valid.eq(self.s_axis_video_tvalid & has_low),
            words.payload.data.eq(Cat(low, self.s_axis_video_tdata)),
            words.payload.last.eq(self.s_axis_video_tlast),
            self.s_axis_video_tready.eq(words.ready | ~has_low),
            matcher.i_keep_above.eq(CONFIG.keep_above),
            Cat(getattr(self, f"{MATCHES}_{port}") for port in ("tdata", "tlast", "tvalid")).eq(
                Cat(matches.payload.data, matches.payload.last, matches.valid)
            ),
            matches.ready.eq(getattr(self, f"{MATCHES}_tready")),
        ]
        with m.If(self.s_axis_video_tvalid & self.s_axis_video_tready):
            m.d.sync += [low.eq(self.s_axis_video_tdata), has_low.eq(~has_low)]
        return m


def design(pattern: DescriptorPattern, lanes: int) -> Design:
    """The matcher alone, ready to be simulated."""

    def top() -> MatcherTop:
        return MatcherTop(Matcher(config=CONFIG, pattern=pattern, lanes=lanes, max_features=MAX_FEATURES))

    identity = f"{CONFIG} {pattern} {lanes} {MAX_FEATURES} {digest_sources()} {Path(__file__).read_text()}"
    return Design(f"the matcher, {pattern.name}, {lanes} lanes", Ports((MATCHES,)), top, identity)


def partners(count: int, pattern: DescriptorPattern) -> tuple[Records, Records]:
    """Features of two frames, the right ones in another order and with some of their bits turned round."""
    rng = np.random.default_rng(count)
    left = np.zeros(count, feature_record(pattern.descriptor_bytes, pattern.window_bytes).dtype)
    left["tag"] = Tag.FEATURE
    left["x"], left["y"] = rng.integers(0, 1 << 16, (2, count))
    left["sector"] = rng.integers(0, SECTORS, count) if pattern.oriented else 0
    left["descriptor"] = rng.integers(0, 256, (count, pattern.descriptor_bytes))
    right = left[rng.permutation(count)]
    noise = rng.uniform(0, LARGEST_NOISE, (count, 1))
    right["descriptor"] ^= np.packbits(rng.random((count, pattern.bits)) < noise, axis=1)
    for features in (left, right):
        features["index"] = np.arange(count)
    return left, right


def segment(frames: tuple[Records, ...], lanes: int) -> Segment:
    """Packets of features as beats; the last beat of each is marked as a start, whose clock is recorded."""
    beats = []
    for number, features in enumerate(frames):
        status = np.zeros(1, FRAME_STATUS.dtype_padded_to(features.dtype.itemsize))
        status["tag"], status["good"], status["features"], status["frame"] = Tag.FRAME_STATUS, 1, len(features), number
        beats.append(np.frombuffer(features.tobytes() + status.tobytes(), np.uint32))
    flags = np.zeros(sum(map(len, beats)), np.uint8)
    flags[np.cumsum([len(each) for each in beats]) - 1] = START_OF_FRAME
    pairs = len(frames[0]) * len(frames[1])
    return Segment(np.concatenate(beats), flags, len(frames), cycle_limit=2 * pairs // lanes + 20 * flags.size + 10_000)


def row(pattern: DescriptorPattern, lanes: int, count: int) -> dict[str, Any]:
    """Simulate two frames of ``count`` features.

    Raises
    ------
    AssertionError
        If a match differs from the golden model's.
    """
    frames = partners(count, pattern)
    (recording,) = verilator.simulate(design(pattern, lanes), [segment(frames, lanes)], progress=print)
    output = recording.outputs[MATCHES]
    golden = match(*frames, pattern, CONFIG)
    found = output.packets[1].view(MATCH.dtype)[:-1]
    assert np.array_equal(found, golden), f"{pattern.name}, {lanes} lanes, {count} features: matches differ"
    cycles = int(output.ends[1, 1] - recording.starts[1])
    searched = count * count // lanes
    return {
        "descriptor": pattern.name,
        "lanes": lanes,
        "features": count,
        "matches": len(found),
        "cycles": cycles,
        "F * F / lanes": searched,
        "overhead": cycles - searched,
        "overhead %": round(100 * (cycles - searched) / searched, 1),
        f"ms at {CLOCK_MHZ} MHz": round(cycles / CLOCK_MHZ / 1000, 2),
    }


def main(json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here.")] = None) -> None:
    """Print a row for each build and number of features."""
    builds = itertools.product(DESCRIPTORS, LANES, FEATURES)
    rows = [row(PATTERNS[descriptor], lanes, features) for descriptor, lanes, features in builds]
    table = Table(*rows[0], title="matcher, clocks a frame")
    for each in rows:
        table.add_row(*map(str, each.values()))
    Console().print(table)
    if json_file:
        json_file.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
