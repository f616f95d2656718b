"""Which commands let libraries print, and the exit statuses of what ends a command."""

import contextlib
import sys
from collections.abc import Iterator

import pytest

from skymosaic import cli


@pytest.mark.parametrize(
    ("words", "noisy"),
    [
        ("panel", True),
        ("panel --port 0", True),
        ("mosaic a.jpg -v", True),
        ("--verbose mosaic a.jpg", True),
        ("mosaic a.jpg", False),
        ("mosaic panel", False),
        ("", False),
    ],
)
def test_libraries_print_for_the_panel_and_where_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, words: str, *, noisy: bool
) -> None:
    quiet: list[bool] = []

    @contextlib.contextmanager
    def without_messages() -> Iterator[None]:
        quiet.append(True)
        yield

    monkeypatch.setattr(cli, "without_library_messages", without_messages)
    monkeypatch.setattr(cli, "_run", lambda: 7)
    monkeypatch.setattr(sys, "argv", ["skymosaic", *words.split()])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 7
    assert bool(quiet) != noisy


def test_a_closed_pipe_has_the_status_of_sigpipe(monkeypatch: pytest.MonkeyPatch) -> None:
    abandoned: list[bool] = []
    monkeypatch.setattr(cli, "abandon_output", lambda: abandoned.append(True))
    by_click = SystemExit(1)
    by_click.__context__ = BrokenPipeError()
    ends = (SystemExit(3), KeyboardInterrupt(), BrokenPipeError(), by_click)
    assert [cli._status_of(end) for end in ends] == [3, 130, 141, 141]
    assert len(abandoned) == 2
