"""The options of every command, before and behind its name, and the packages that few commands need."""

from typing import Any

import pytest
import typer

from skymosaic.cli.common import with_common_options
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError


def talk() -> None:
    """A command that prints each kind of line."""
    session.tell("progress")
    session.warn("something odd")
    session.show("result")


@pytest.mark.parametrize(
    ("before", "behind", "told"),
    [
        ({}, {}, ["progress", "warning: something odd"]),
        ({"quiet": True}, {}, ["warning: something odd"]),
        ({"quiet": False}, {"quiet": True}, ["warning: something odd"]),
        ({"verbose": True}, {}, ["skymosaic", "progress", "warning: something odd"]),
        ({"verbose": False}, {"verbose": True}, ["skymosaic", "progress", "warning: something odd"]),
    ],
)
def test_common_options_may_stand_before_the_command(
    before: dict[str, bool], behind: dict[str, bool], told: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    run = with_common_options("talk", talk, before)
    run(**{"as_json": False, "quiet": False, "verbose": False, **behind})
    printed = capsys.readouterr()
    assert printed.out == "result\n"
    # The first line of details also has versions.
    assert [line if "Python" not in line else line.split()[0] for line in printed.err.splitlines()] == told


@pytest.mark.parametrize(
    ("missing", "says"),
    [
        ("nicegui", "talk needs nicegui; .*panel"),
        ("amaranth", "talk needs amaranth; .*hardware"),
        ("matplotlib", "talk needs matplotlib; .*plots"),
        ("numpy", None),
        (None, None),
    ],
)
def test_a_package_that_few_commands_need_is_named_with_its_remedy(missing: str | None, says: str | None) -> None:
    def command() -> None:
        raise ModuleNotFoundError("no module", name=missing)

    run: Any = with_common_options("talk", command, {})
    with pytest.raises(InputError if says else ModuleNotFoundError, match=says):
        run(as_json=False, quiet=False, verbose=False)


@pytest.mark.parametrize("status", [0, 1])
def test_the_status_of_a_command_is_that_of_the_program(status: int, capsys: pytest.CaptureFixture[str]) -> None:
    def command() -> None:
        session.status = status

    run: Any = with_common_options("talk", command, {})
    try:
        run(as_json=True, quiet=False, verbose=False)
        ended_with = 0
    except typer.Exit as end:
        ended_with = end.exit_code
    assert ended_with == status
    assert f'"status": {status}' in capsys.readouterr().out
