"""Rows of figures: a table on the terminal, and the JSON file that the documentation makes the same table from.

Also what programs that measure take: folders of public photographs by their names.
"""

import functools
import inspect
import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

MEASURED = Path(__file__).parents[1] / "docs" / "measured"
"""Folder of the files that the documentation is made from."""
Row = dict[str, str | int | float]
"""Heading and figure, in the order of the columns; the first column names the row."""
Flights = Annotated[list[str], typer.Argument(help="Folders of photographs, or public flights; one flight each.")]
PartsOfNames = Annotated[list[str] | None, typer.Argument(help="Parts of names; all by default.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write command and rows here; docs/measured has them.")]


def program(doc: str | None) -> typer.Typer:
    """A program of sub-commands that says what its module says."""
    return typer.Typer(help=doc, add_completion=False, no_args_is_help=True)


def public_folder(name: str | Path) -> Path:
    """A folder by its path, or by its name among the public photographs that SKYMOSAIC_DATA names."""
    data = Path(os.environ.get("SKYMOSAIC_DATA", ""))
    for folder in (Path(name), data / name, data / "flights" / name):
        if folder.is_dir():
            return folder
    raise SystemExit(f"{name}: no such folder; set SKYMOSAIC_DATA to that of the public photographs, or name a path")


def in_process(function: Callable[..., Any], *arguments: Any) -> Any:
    """What a function returns in a fresh process."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def reported(title: str) -> Callable[[Callable[..., Iterable[Row]]], Callable[..., None]]:
    """Decorate what measures rows: a command that reports them, with the option ``--json``.

    The title may have names of the command's options in braces. Where some rows were chosen by ``names``, the others
    stay in the file.
    """

    def decorate(measure: Callable[..., Iterable[Row]]) -> Callable[..., None]:
        @functools.wraps(measure)
        def command(*, json_file: Path | None = None, **options: Any) -> None:
            rows = list(measure(**options))
            report(title.format(**options), rows, json_file, keep_others=bool(options.get("names")))

        signature = inspect.signature(measure)
        with_json = inspect.Parameter("json_file", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=JsonFile)
        vars(command)["__signature__"] = signature.replace(parameters=[*signature.parameters.values(), with_json])
        return command

    return decorate


def report(title: str, rows: Sequence[Row], json_file: Path | None = None, *, keep_others: bool = False) -> None:
    """Print rows as a table, and write them with the command that measured them.

    With ``keep_others`` only some rows were measured: they take the places of those that the file has of the same name.
    """
    table = Table(*(rows[0] if rows else ()), title=title)
    for row in rows:
        table.add_row(*map(str, row.values()))
    Console(width=None if sys.stdout.isatty() else 200).print(table)
    if json_file and keep_others and json_file.exists():
        before = json.loads(json_file.read_text(encoding="utf-8"))
        named = {next(iter(row.values())): row for row in (*before["rows"], *rows)}
        write(json_file, before["command"], [*named.values()])
    elif json_file:
        write(json_file, command_line(), rows)


def write(path: Path, command: str, rows: Sequence[Row]) -> None:
    """Write a file of ``docs/measured``, a row in each line, so that a changed figure is a changed line."""
    lines = ",\n".join(f"    {json.dumps(row, ensure_ascii=False)}" for row in rows)
    path.write_text(f'{{\n  "command": {json.dumps(command)},\n  "rows": [\n{lines}\n  ]\n}}\n', encoding="utf-8")


def command_line() -> str:
    """The command that is running, without the option that names the file."""
    words = sys.argv[1:]
    if "--json" in words:
        place = words.index("--json")
        del words[place : place + 2]
    return " ".join([f"python -m bench.{Path(sys.argv[0]).stem}", *(f'"{w}"' if " " in w else w for w in words)])
