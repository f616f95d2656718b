"""What the shell completes, from a table of all options: a command takes seconds to import, and a key must not.

``python -m tools.completion`` writes the table anew.
"""

import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer
from typer.main import get_command

TABLE = Path(__file__).with_suffix(".json")
KINDS: dict[str, Any] = {"flag": bool, "path": Path | None, "paths": list[Path], "text": str | None, "texts": list[str]}
"""What the shell has to know of a parameter's type: whether a value follows, whether it is a file, and one or several.
"""


def sketch(name: str) -> Any:
    """A command, or a group of commands, that is completed as the one of this name, but does nothing."""
    made = typer.Typer(add_completion=False)
    table = json.loads(TABLE.read_text(encoding="utf-8"))
    for each in (own := [words for words in table if words.split()[0] == name]):
        made.command(each.split()[-1])(_with_parameters([_parameter(*row) for row in table[each]]))
    if own != [name]:
        made.callback()(lambda: None)
    return get_command(made)


def _with_parameters(parameters: list[inspect.Parameter]) -> Callable[..., None]:
    def command() -> None:
        raise AssertionError("completed, not called")

    # Typer reads options from the signature and the annotations.
    vars(command)["__signature__"] = inspect.Signature(parameters)
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    return command


def _parameter(name: str, kind: str, flags: list[str] | None, about: str, choices: list[str]) -> inspect.Parameter:
    complete = (lambda: choices) if choices else None
    if flags is None:
        info = typer.Argument(None, help=about, autocompletion=complete)
    else:
        info = typer.Option(None, *flags, help=about, autocompletion=complete)
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=KINDS[kind], default=info)
