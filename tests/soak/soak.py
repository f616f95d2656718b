"""Runs the accelerator for a long time on everything that may happen: ``python -m tests.soak.soak 100000000``.

Random frames, sizes, settings, gaps and stalls, bad frames, register writes in mid-frame, clears and resets, all from
one seed, on the design compiled by Verilator. Every good frame must equal the golden model, and every bad one must be
reported with its cause; none may be lost or doubled. Prints a line of counts.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import time
from collections import Counter, deque
from dataclasses import dataclass, field

import numpy as np
import typer
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.records import MATCH, Cause
from hdl.registers.register_map import IDENTITY, register_writes
from sim.backends.interface import FrameResult, Progress, silent
from sim.simulators import verilator
from sim.simulators.accelerator_designs import FEATURES, MATCHES, design_accelerator
from sim.simulators.compiled import Bench
from sim.simulators.hardware import decode_frame, decode_status
from sim.simulators.recording import Output, Pauses, Segment
from sim.simulators.scoreboard import find_mismatch
from tests.soak.frames import BUILD, CONFIG, SentFrame, Source

app = typer.Typer(help=__doc__, add_completion=False)

HANG_CYCLES = 2_000_000
QUIET_CYCLES = 3000
DRAIN_CYCLES = 20_000
REPORT_CLOCKS = 10_000_000
EVENTS = {"go on": 0.35, "split": 0.35, "drain": 0.1, "clear": 0.1, "reset": 0.1}
"""What may happen while an episode's last frame is under way, and how often."""
NOTHING = np.empty(0, np.uint64), np.empty(0, np.uint8)


class SoakError(AssertionError):
    """The accelerator has lost, doubled or changed a frame."""


@dataclass
class Packets:
    """What has come from one output."""

    words: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))
    whole: deque[NDArray[np.uint64]] = field(default_factory=deque)
    was_cleared: bool = False
    """The next packet may be the one that was under way at a clear."""

    def add(self, output: Output) -> None:
        """Append words; those of the last packet may still be incomplete."""
        before, self.words = len(self.words), np.concatenate([self.words, output.words])
        *whole, self.words = np.split(self.words, before + output.ends[:, 0].astype(np.intp))
        self.whole.extend(whole)


class Soak:
    """Sends episodes of frames, each with settings of its own, and compares whatever comes back.

    Parameters
    ----------
    bench : Bench
    seed : int
    """

    def __init__(self, bench: Bench, seed: int) -> None:
        self._bench = bench
        self._rng = np.random.default_rng(seed)
        self._source = Source(self._rng)
        self._clocks_before_reset = 0
        self._start_over()
        self.counts: Counter[str] = Counter()

    @property
    def clocks(self) -> int:
        """Simulated so far."""
        return self._clocks_before_reset + self._bench.cycle

    def run(self, clocks: int) -> str:
        """Run episodes until the clock count is reached; then every frame must have come, and nothing else.

        Returns the line of counts.
        """
        while self.clocks < clocks:
            self._episode()
        self._drain()
        listed = ", ".join(f"{name} {count}" for name, count in sorted(self.counts.items()))
        return f"{self.clocks} clocks: {listed}"

    def _start_over(self) -> None:
        """No frame is under way."""
        self._sent: deque[SentFrame] = deque()
        self._outputs = {FEATURES: Packets(), MATCHES: Packets()}
        self._rest = NOTHING

    def _episode(self) -> None:
        """Write settings, while a frame may be under way; send its rest and new frames; let something happen."""
        settings, frames = self._source.episode()
        self._sent.extend(frames)
        event = str(self._rng.choice(list(EVENTS), p=list(EVENTS.values())))
        self.counts[event] += 1
        parts = [self._rest, *((frame.data, frame.flags) for frame in frames)]
        data, flags = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        cut = len(data)
        if event in {"split", "clear", "reset"} and frames[-1].can_be_split:
            # Its first pixels have been sent: the frame keeps the settings with which it has started.
            cut -= int(self._rng.integers(len(frames[-1].data) // 2))
        self._rest = data[cut:], flags[cut:]
        self._stream(data[:cut], flags[:cut], register_writes(settings))
        if event == "drain":
            self._drain()
        elif event == "clear":
            self._clear(settings)
        elif event == "reset":
            self._clocks_before_reset = self.clocks
            self._bench.reset()
            self._source.start_over(set())
            self._start_over()

    def _stream(self, data: NDArray[np.uint64], flags: Pixels, writes: list[tuple[int, int]]) -> None:
        gaps, stalls = (int(self._rng.choice([0, 0, 0, 20, 60, 160])) for _ in range(2))
        pauses = Pauses(gaps, stalls, int(self._rng.integers(1 << 24)))
        limit = HANG_CYCLES + 100 * len(data)
        is_done, recording = self._bench.stream(Segment(data, flags, 0, limit, writes=writes), pauses)
        if not is_done:
            raise SoakError(f"pixels wait for ever, clock {self.clocks}")
        if self._bench.read(0) != IDENTITY:
            raise SoakError(f"a register is not what it was, clock {self.clocks}")
        self._take(recording.outputs)

    def _drain(self) -> None:
        """Wait for all frames, and a while longer, in which nothing may come."""
        waited = 0
        rest, self._rest = self._rest, NOTHING
        self._stream(*rest, [])
        while self._sent and waited < HANG_CYCLES:
            self._wait(DRAIN_CYCLES)
            waited += DRAIN_CYCLES
        if self._sent:
            raise SoakError(f"frame {self._sent[0].number} is lost, clock {self.clocks}")
        self._wait(QUIET_CYCLES)
        if any(packets.whole or len(packets.words) for packets in self._outputs.values()):
            raise SoakError(f"words come after the last frame, clock {self.clocks}")

    def _wait(self, cycles: int) -> None:
        # More packets than can come: it ends at its limit.
        _, recording = self._bench.stream(Segment(*NOTHING, 1 << 32, cycles), Pauses())
        self._take(recording.outputs)

    def _clear(self, settings: dict[str, int]) -> None:
        """Forget all frames. A packet under way is ended; the next frames differ from it in size."""
        for address, word in register_writes({**settings, "clear": 1}):
            self._bench.write(address, word)
        self._source.start_over({frame.size_px for frame in self._sent})
        self._sent.clear()
        self._rest = NOTHING
        for packets in self._outputs.values():
            packets.whole.clear()
            packets.was_cleared = True

    def _take(self, outputs: dict[str, Output]) -> None:
        """Pair the packets of features and of matches, and compare them with what was sent."""
        for name, packets in self._outputs.items():
            packets.add(outputs[name])
            if packets.was_cleared and packets.whole:
                packets.was_cleared = False
                if self._was_under_way(packets.whole[0], name):
                    packets.whole.popleft()
                    self.counts["packets broken off"] += 1
        features, matches = (packets.whole for packets in self._outputs.values())
        while features and matches:
            found = decode_frame(features.popleft(), matches.popleft(), CONFIG)
            if not self._sent:
                raise SoakError(f"frame {found.status['frame']} was not sent, or is doubled; clock {self.clocks}")
            self._compare(self._sent.popleft(), found)

    def _was_under_way(self, words: NDArray[np.uint64], name: str) -> bool:
        """Whether a packet began before the clear."""
        pattern = CONFIG.front_end.pattern
        feature = pattern.record
        status = decode_status(feature if name == FEATURES else MATCH, words)
        size_px = (int(status["width"]), int(status["height"]))
        return status["causes"] == Cause.CLEARED or not self._sent or size_px != self._sent[0].size_px

    def _compare(self, sent: SentFrame, found: FrameResult) -> None:
        if sent.golden is not None:
            mismatch = find_mismatch([sent.golden], [found])
            if mismatch:
                raise SoakError(f"{dataclasses.replace(mismatch, frame=sent.number)}; clock {self.clocks}")
            self.counts["good frames"] += 1
            self.counts["features"] += len(found.features)
            self.counts["matches"] += len(found.matches)
            return
        for status in (found.status, found.match_status):
            if status["good"] or status["causes"] != sent.cause or status["frame"] != sent.number:
                raise SoakError(f"frame {sent.number} should be bad ({sent.cause!r}): {status}; clock {self.clocks}")
        if len(found.matches):
            raise SoakError(f"bad frame {sent.number} has matches; clock {self.clocks}")
        self.counts[f"bad ({sent.cause.name})"] += 1


def soak(clocks: int, seed: int, *, report: Progress = silent) -> str:
    """Run for a number of clocks; ``report`` receives a line of counts now and then. Returns the last line."""
    design = design_accelerator(BUILD)
    library = verilator.build_library(design, progress=report)
    with contextlib.closing(Bench(library, design.ports)) as bench:
        run = Soak(bench, seed)
        for until in range(REPORT_CLOCKS, clocks, REPORT_CLOCKS):
            report(run.run(until))
        return run.run(clocks)


@app.command()
def main(clocks: int, seed: int = 1) -> None:
    """Run for CLOCKS clocks, and print a line of counts."""
    start = time.process_time()
    line = soak(clocks, seed, report=functools.partial(print, flush=True))
    print(f"{line}; seed {seed}, {time.process_time() - start:.0f} s of processor time")


if __name__ == "__main__":
    app()
