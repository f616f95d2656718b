"""Progress of a flight's stages on standard error."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

from skymosaic.cli.session import session
from skymosaic.common.later import Later
from skymosaic.running.workers import Progress

rich_progress = Later("rich.progress")
# Between two lines of one stage where progress is not drawn in place.
LINE_EVERY_S = 10.0


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """A progress callback: on a terminal it draws a bar per stage, with the time that is left; else it prints lines."""
    if not session.animated:
        yield print_stages(session.tell)
        return
    columns = (
        rich_progress.TextColumn("{task.description}", markup=False),
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TimeRemainingColumn(),
    )
    with rich_progress.Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, int] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks or bars.tasks[tasks[stage]].finished:
                # Of a stage without steps, nothing else says that it has ended.
                for task in bars.tasks:
                    if task.total is None:
                        bars.update(task.id, total=1, completed=1)
                tasks[stage] = bars.add_task(stage, total=total or None)
            bars.update(tasks[stage], completed=done)

        yield show


def print_stages(tell: Callable[[str], None]) -> Progress:
    """A progress callback that prints a line when a stage begins, one now and then, and one at its end."""
    last_stage, printed_s = "", 0.0

    def show(stage: str, done: int, total: int) -> None:
        nonlocal last_stage, printed_s
        now = time.monotonic()
        if stage != last_stage or done >= total or now - printed_s >= LINE_EVERY_S:
            last_stage, printed_s = stage, now
            tell(f"{stage} {done}/{total}" if total else stage)

    return show
