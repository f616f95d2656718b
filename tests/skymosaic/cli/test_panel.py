"""What the command of the panel hands to its server, and what it says of the address."""

import json
import sys
import threading
import webbrowser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.conftest import Run

ADDRESS = "http://127.0.0.1:8080/x"


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What a server was started with, which only announces itself."""
    calls: list[Any] = []

    def serve(*given: Any) -> None:
        calls.append(given[:-1])
        given[-1](ADDRESS, "the port was taken" if given[0] == 9 else "")

    monkeypatch.setitem(sys.modules, "skymosaic.panel.server", SimpleNamespace(serve=serve))
    return calls


def test_the_server_gets_what_was_typed_or_is_usual(run: Run, served: list[Any]) -> None:
    status, out, errors = run("panel")
    assert (status, out.decode(), errors) == (0, f"the panel is at {ADDRESS} (Ctrl-C ends it)\n", "")
    words = ("--board", "a:1", "--board", "b", "--root", "x", "--root", "y", "--runs", "kept", "--port", "9")
    status, out, errors = run("panel", *words, "--json")
    assert (status, json.loads(out)["address"], errors) == (0, ADDRESS, "warning: the port was taken\n")
    (port, boards, roots, kept), second = served
    assert (port, boards, roots, kept.parts[-2:]) == (8080, (), [Path.home()], ("skymosaic", "runs"))
    assert second == (9, ("board:a:1", "board:b"), [Path("x"), Path("y")], Path("kept"))


class AtOnce(threading.Thread):
    """A thread that keeps nothing waiting, and runs in the one that starts it."""

    def start(self) -> None:
        assert self.daemon
        self.run()


@pytest.mark.parametrize(("terminal", "words"), [(True, ()), (False, ()), (True, ("--no-browser",))])
@pytest.mark.usefixtures("served")
def test_a_browser_is_opened_on_a_terminal_only(
    run: Run, monkeypatch: pytest.MonkeyPatch, *, terminal: bool, words: tuple[str, ...]
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr(threading, "Thread", AtOnce)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    assert run("panel", *words)[0] == 0
    assert opened == ([ADDRESS] if terminal and not words else [])
