"""Progress in steps: what a worker reports as one line, and the time that is left by it."""

from __future__ import annotations

import re
import time

_STEP = re.compile(r"(?P<stage>.*): (?P<done>\d+) of (?P<total>\d+)")
FEWEST_SECONDS = 1.0
"""No estimate before a stage has run for this time."""


def step_line(stage: str, done: int, total: int) -> str:
    """A line of progress that `Steps` understands."""
    return f"{stage}: {done} of {total}"


class Steps:
    """The share of the present stage that is done, and the seconds that are left of it.

    Attributes
    ----------
    share : float or None
        0 to 1; None while the stage has no steps.
    """

    def __init__(self) -> None:
        self.share: float | None = None
        self._stage = ""
        self._started = 0.0
        self._done_at_start = 0
        self._done = 0
        self._total = 0

    def follow(self, line: str) -> None:
        """Take note of a line of progress."""
        found = _STEP.fullmatch(line)
        if found is None:
            self.share = None
            return
        self._done, self._total = int(found["done"]), int(found["total"])
        self.share = self._done / self._total if self._total else None
        if found["stage"] != self._stage:
            self._stage, self._started, self._done_at_start = found["stage"], time.monotonic(), self._done

    def seconds_left(self) -> float | None:
        """Estimated from the steps of this stage so far; None if they tell nothing yet."""
        seconds, steps = time.monotonic() - self._started, self._done - self._done_at_start
        if self.share is None or steps < 1 or seconds < FEWEST_SECONDS:
            return None
        return seconds / steps * (self._total - self._done)
