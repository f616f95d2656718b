"""Live numbers: how many frames come and are used per second, and what the accelerator takes for each of them."""

import importlib
import time
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from golden_model.arrays import Records
from golden_model.config import Config
from golden_model.geometry.estimator import MAX_CYCLES
from golden_model.matching.matcher import match
from golden_model.timing import FrameWork, steady_pace
from skymosaic.geometry.estimators import FABRIC
from skymosaic.imagery.live_frames import LiveFrame
from skymosaic.mosaicking.live.update import LiveUpdate

CLOCK_HZ = 150_000_000
"""The accelerator's target on a Zynq-7020, not reached on a board yet; 1080p60 video needs 148.5 MHz."""


class Pace:
    """Counts frames as they come and are added, and the accelerator's clocks for them.

    Work is what is done between one frame and the next, by this computer and with a simulated accelerator mostly by the
    simulation; the clock also counts waiting for frames, reading them, and those of a video that are passed over.
    What the accelerator itself takes is computed from its exact timeline (`golden_model.timing`), for frames that
    follow each other without a pause: from the size of a frame, its features, and its matches with the frame before it.
    Where the chip estimates homographies, each takes as long as any can.
    """

    def __init__(self, config: Config, backend: str, estimator: str = "prosac") -> None:
        self._config = config
        self._estimate_cycles = MAX_CYCLES if estimator == FABRIC else None
        self._has_clocks = backend != "golden"
        self._started_s = time.monotonic()
        self._seconds = self._work_seconds = 0.0
        self._seen = self._used = self._dropped = 0
        self._before: Records | None = None
        self._paces: list[tuple[int, int]] = []

    def watch(self, frames: Iterable[LiveFrame]) -> Iterator[LiveFrame]:
        """The same frames, while the time is taken that whoever asks for them works on each."""
        for frame in frames:
            self._seen, start_s = frame.seen, time.monotonic()
            yield frame
            end_s = time.monotonic()
            self._work_seconds, self._seconds = self._work_seconds + end_s - start_s, end_s - self._started_s

    def add(self, update: LiveUpdate) -> None:
        """Count a frame as used or dropped: unreadable, with too few features, or beyond the canvas limit."""
        self._used += not update.reason
        self._dropped += bool(update.reason)
        left, right = self._before, update.features
        if not self._has_clocks or right is None:
            return
        self._before = right
        # The first frame has nothing to match.
        if left is None:
            return
        matches = match(left, right, self._config.front_end.pattern, self._config.matcher)
        # The accelerator walks over the left features in their order.
        rows = np.sort(matches["left_index"]).astype(int)
        work = FrameWork(
            *update.size_px,
            good=True,
            left=len(left),
            right=len(right),
            rows=rows,
            estimate_cycles=self._estimate_cycles,
        )
        # Imported late: the help of `mosaic` imports this module, and needs no hardware.
        lanes = importlib.import_module("hdl.build").Build.lanes
        pace = steady_pace(work, self._config, lanes=lanes)
        self._paces += [pace] if pace else []

    @property
    def numbers(self) -> dict[str, Any]:
        """Frames, seconds and frames per second; with clocks also the accelerator's, for its slowest frame."""
        numbers: dict[str, Any] = {
            "seen": self._seen,
            "used": self._used,
            "dropped": self._dropped,
            "work_seconds": round(self._work_seconds, 3),
            "clock_seconds": round(self._seconds, 3),
            "used_per_second_of_work": round(self._used / self._work_seconds, 2) if self._work_seconds else None,
            "seen_per_second_of_clock": round(self._seen / self._seconds, 2) if self._seconds else None,
        }
        if self._paces:
            clocks, latency = (max(values) for values in zip(*self._paces, strict=True))
            numbers["accelerator"] = {
                "clocks_per_frame": clocks,
                "frames_per_second": round(CLOCK_HZ / clocks, 1),
                "latency_ms": round(1000 * latency / CLOCK_HZ, 3),
            }
        return numbers

    def __str__(self) -> str:
        """One line of all numbers."""
        numbers = self.numbers
        line = "{seen} frames seen, {used} used, {dropped} dropped"
        if self._work_seconds:
            line += (
                "; {used_per_second_of_work:g} used per second of work ({work_seconds:.1f} s), "
                "{seen_per_second_of_clock:g} seen per second of the clock ({clock_seconds:.1f} s)"
            )
        if self._paces:
            line += (
                "; the accelerator at {mhz:g} MHz: {frames_per_second:g} per second, "
                "last pixel to last match {latency_ms:g} ms"
            )
        return line.format(**numbers, **numbers.get("accelerator", {}), mhz=CLOCK_HZ / 1e6)
