"""What is printed beside a terminal and on one, how a command's progress is shown, and what its object has."""

import io
import json
from pathlib import Path
from typing import Any

import pytest
from rich.table import Table

from skymosaic.cli.session import PIPED_WIDTH, Session, Terminal
from skymosaic.common.errors import InputError

NAME = "photographs of the southern field/DJI_20260412_0001.JPG"


def named() -> Table:
    table = Table("photograph", "reason")
    table.add_row(NAME, "too few features, because nearly all of it is water")
    return table


def test_a_table_in_a_pipe_has_its_rows_on_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    Terminal(width=60).show(named())
    printed = capsys.readouterr().out
    assert NAME in printed
    assert max(map(len, printed.splitlines())) < PIPED_WIDTH / 5


def test_a_table_on_a_terminal_keeps_to_its_width() -> None:
    shown = io.StringIO()
    Terminal(file=shown, force_terminal=True, color_system=None, width=60).show(named())
    assert "photographs" in shown.getvalue()
    assert max(map(len, shown.getvalue().splitlines())) <= 60


def test_names_are_printed_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    terminal = Terminal(width=20)
    terminal.show(f"[bold]{NAME}[/bold]\n2")
    terminal.print_line(f"[red]{NAME}")
    assert capsys.readouterr().out.splitlines() == [f"[bold]{NAME}[/bold]\\n2", f"[red]{NAME}"]


def begun(*, quiet: bool = False, verbose: bool = False, as_json: bool = False, command: str = "mosaic") -> Session:
    session = Session()
    session.begin(command, started_s=0.0, quiet=quiet, verbose=verbose, as_json=as_json)
    return session


@pytest.mark.parametrize(
    ("is_terminal", "quiet", "verbose", "animated"),
    [
        (True, False, False, True),
        (False, False, False, False),
        (True, True, False, False),
        (True, False, True, False),
    ],
)
def test_progress_is_drawn_on_a_terminal_unless_lines_are_wanted(
    monkeypatch: pytest.MonkeyPatch, *, is_terminal: bool, quiet: bool, verbose: bool, animated: bool
) -> None:
    monkeypatch.setattr("skymosaic.cli.session.Terminal.is_terminal", is_terminal)
    assert begun(quiet=quiet, verbose=verbose).animated == animated


def test_the_object_has_what_was_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    session = begun(as_json=True)
    session.note("note: add `all_groups`")
    session.warn("`scale` is\nlarge")
    session.wrote(tmp_path)
    session.stream({"frame": 1, "error_px": float("nan")})
    session.show("a result")
    session.numbers = {"notes": ["turned"], "size": [3, 4]}
    with session.working("drawing") as step:
        step("half of it")
    session.end(2, "no `gsd_m`")
    first, last = map(json.loads, (printed := capsys.readouterr()).out.splitlines())
    assert first == {"frame": 1, "error_px": None}
    expected: dict[str, Any] = {
        "command": "mosaic", "status": 2, "error": "no --gsd", "warnings": ["--scale is\\nlarge"],
        "outputs": [str(tmp_path)], "notes": ["note: add --all-groups", "turned"], "size": [3, 4],
    }  # fmt: skip
    assert {key: last[key] for key in expected} == expected
    lines = ["note: add --all-groups", "warning: --scale is\\nlarge", "drawing", "half of it"]
    assert printed.err.splitlines() == lines


@pytest.mark.parametrize(("command", "seconds", "error"), [("", 1.0, None), ("mosaic", None, None), ("mosaic", 1, "x")])
def test_times_are_those_of_a_command_with_stages_that_succeeds(
    capsys: pytest.CaptureFixture[str], command: str, seconds: float | None, error: str | None
) -> None:
    session = begun(command=command)
    session.seconds = {"drawing": seconds} if seconds else {}
    session.end(0, error)
    assert capsys.readouterr() == ("", "")


def test_standard_output_takes_one_thing(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    with pytest.raises(InputError, match="-o - and --json both write to standard output"):
        begun(as_json=True).destination(Path("-"), "m.png").__enter__()
    session = begun()
    with session.destination(Path("-"), "m.png") as path:
        path.write_bytes(b"a mosaic")
    session.show("wrote it")
    assert capfdbinary.readouterr() == (b"a mosaic", b"wrote it\n")
    with begun(as_json=True).destination(Path("m.png"), "other.png") as path:
        assert path == Path("m.png")
