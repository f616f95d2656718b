"""What is printed beside a terminal and on one."""

import io

import pytest
from rich.table import Table

from skymosaic.cli.console import PIPED_WIDTH, Terminal

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
