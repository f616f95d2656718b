"""Progress of a flight's stages, and the times at the end."""

import importlib
import io
import json
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console
from rich.progress import Progress

from skymosaic.cli import progress
from skymosaic.cli.session import Session


def test_beside_a_terminal_a_stage_is_a_line_at_its_begin_now_and_then_and_at_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s, told = [100.0], list[str]()
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    show = progress.print_stages(told.append)
    for done in range(26):
        show("features", done, 25)
        now_s[0] += 1
    show("lens", 0, 0)
    show("links", 0, 25)
    assert told == ["features 0/25", "features 10/25", "features 20/25", "features 25/25", "lens", "links 0/25"]


def test_on_a_terminal_each_stage_is_a_bar_that_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one without steps, and one that comes again."""
    drawn, shown = list[Any](), io.StringIO()

    def draw(*columns: Any, **options: Any) -> Progress:
        drawn.append(Progress(*columns, **options))
        return drawn[-1]

    monkeypatch.setattr(Session, "animated", True)
    monkeypatch.setattr(progress, "Console", lambda **_: Console(file=shown, force_terminal=True, width=100))
    monkeypatch.setattr("rich.progress.Progress", draw)
    with progress.progress_bars() as show:
        for step in (("lens", 0, 0), ("features", 0, 4), ("features", 3, 4), ("features", 4, 4), ("features", 1, 2)):
            show(*step)
        (bars,) = drawn
        found = [(task.description, task.completed, task.total, task.finished) for task in bars.tasks]
    assert found == [("lens", 1, 1, True), ("features", 4, 4, True), ("features", 1, 2, False)]
    assert "4/4" in shown.getvalue()


def test_times_add_up_to_the_wall_time(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    now_s = [3.0]
    module = importlib.import_module("skymosaic.cli.session")
    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: now_s[0]))
    for as_json in (True, False):
        session = Session()
        session.begin("mosaic", started_s=1.0, quiet=False, verbose=False, as_json=as_json)
        session.seconds["features"] = 4.0
        now_s[0] += 7
        session.end(0)
        session.end(1)
        now_s[0] -= 7
    printed = capsys.readouterr()
    assert json.loads(printed.out)["seconds"] == {"starting": 2, "features": 4, "other": 3, "total": 9}
    assert printed.err.splitlines() == 2 * ["seconds: starting 2.00, features 4.00, other 3.00, total 9.00"]
