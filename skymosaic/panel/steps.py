"""Progress in steps, and the time left."""

import time
from typing import Protocol

MIN_SECONDS = 1.0
"""No estimate until a stage has run for this long."""


class Progress(Protocol):
    """Takes a line of progress, or a stage with the number of its steps, done and in total."""

    def __call__(self, line: str, done: int = 0, total: int = 0, /) -> None:
        """Report progress."""


class Steps:
    """How many steps of the current stage are ``done``, and the seconds left in it."""

    def __init__(self) -> None:
        self.done, self._total = 0, 0
        self._stage, self._started, self._done_at_start = "", 0.0, 0

    @property
    def share(self) -> float | None:
        """Share that is done, 0 to 1; None while the stage has no steps."""
        return self.done / self._total if self._total else None

    def follow(self, stage: str, done: int, total: int) -> None:
        """Note the progress of a stage; ``total`` is 0 if it has no steps."""
        self.done, self._total = done, total
        if stage != self._stage:
            self._stage, self._started, self._done_at_start = stage, time.monotonic(), done

    def seconds_left(self) -> float | None:
        """Estimate the time left from the steps of this stage so far; None without enough of them."""
        seconds, steps = time.monotonic() - self._started, self.done - self._done_at_start
        if self.share is None or steps < 1 or seconds < MIN_SECONDS:
            return None
        return seconds / steps * (self._total - self.done)
