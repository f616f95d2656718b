"""Progress of a flight's stages on standard error."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import progress as rich_progress
from rich.console import Console

from skymosaic.cli.session import session
from skymosaic.flight.workers import Progress

LINE_EVERY_S = 10.0
"""Between two lines of one stage where progress is not drawn in place."""


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """A progress callback: on a terminal a bar for each stage, with the time that is left; else lines."""
    if not session.animated:
        yield ProgressLines(session.tell)
        return
    columns = (
        rich_progress.TextColumn("{task.description}", markup=False),
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TimeRemainingColumn(),
    )
    with rich_progress.Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, rich_progress.TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks or bars.tasks[tasks[stage]].finished:
                tasks[stage] = bars.add_task(stage, total=total or None)
            bars.update(tasks[stage], completed=done)

        yield show


class ProgressLines:
    """Prints a line when a stage begins, one now and then, and one at its end.

    Parameters
    ----------
    tell : callable
        Receives the lines.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._stage = ""
        self._told_s = 0.0

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Take a stage, how many of its steps are done, and how many there are (0: unknown)."""
        now = time.monotonic()
        if stage == self._stage and done < total and now - self._told_s < LINE_EVERY_S:
            return
        self._stage, self._told_s = stage, now
        self._tell(f"{stage} {done}/{total}" if total else stage)
