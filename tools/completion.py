"""Writes the table from which the shell completes: ``python -m tools.completion``."""

import inspect
import json
from collections.abc import Callable, Iterator
from typing import get_args

from typer.models import ArgumentInfo

from skymosaic.cli.commands import COMMANDS, import_functions
from skymosaic.cli.completion import TABLE


def describe_commands() -> str:
    """All commands by the words that call them, with a line of JSON for each parameter."""
    functions = {words: function for name in COMMANDS for words, function in import_functions(name, {}).items()}
    tables = []
    for words, function in functions.items():
        rows = ",\n".join(json.dumps(row) for row in _describe_parameters(function))
        tables.append(f"{json.dumps(words)}: [\n{rows}\n]")
    return "{\n" + ",\n".join(tables) + "\n}\n"


def _describe_parameters(function: Callable[..., None]) -> Iterator[tuple[str, str, list[str] | None, str, list[str]]]:
    """Name, kind, flags (None of an argument), help and choices of each parameter."""
    for parameter in inspect.signature(function).parameters.values():
        of_type, about, *_ = get_args(parameter.annotation)
        value = "flag" if of_type is bool else "path" if "Path" in str(of_type) else "text"
        kind = f"{value}s" if "list" in str(of_type) else value
        # Typer takes the first flag of an annotation for a default, until it reads the annotation.
        flags = [each for each in (about.default, *(about.param_decls or ())) if isinstance(each, str)]
        yield (
            parameter.name,
            kind,
            None if isinstance(about, ArgumentInfo) else flags,
            about.help or "",
            about.autocompletion() if about.autocompletion else [],
        )


if __name__ == "__main__":
    TABLE.write_text(describe_commands(), encoding="utf-8")
