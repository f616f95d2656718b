"""Every command that the documentation quotes exists, with the options that it is quoted with."""

import importlib
import importlib.util
import inspect
import json
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer
from typer.main import get_command

from docs.hooks.measured import table
from skymosaic.cli.commands import COMMANDS
from skymosaic.cli.commands import app as skymosaic

ROOT = Path(__file__).parents[3]
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("constraints/**/*.md")]
SOURCES = [
    path
    for folder in ("bench", "golden_model", "hdl", "sim", "skymosaic", "tools")
    for path in (ROOT / folder).rglob("*.py")
]
SPAN = r"``([^`\n]+)``|`([^`\n]+)`"
"""Quoted in a sentence."""
BLOCK_LINE = r"^ *(?:\$ |\.venv/bin/)?((?:skymosaic|python|make|pip|pytest) .*)$"
"""Quoted in a block of a page."""
ENDS = {"|", "||", "&&", "&", ">", ">>", ";", "#", "..."}
"""Words of a shell behind which another command, a file or a comment comes."""
USAGE_ERROR: Any = typer.BadParameter.__base__
"""Typer's own; it has no public name."""
MAKEFILE = (ROOT / "Makefile").read_text()
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])


def quoted(text: str, pattern: str = SPAN) -> Iterator[list[str]]:
    """The words of each command in a text; those of a clone's environment without their folder."""
    for groups in re.findall(f"(?m:{pattern})", text):
        line = next(filter(None, groups)).replace("…", "...")
        try:
            words = shlex.split(line.replace("\\|", "|"), comments=True)
        except ValueError:
            continue
        while words and re.fullmatch(r"[A-Z_]+=\S*", words[0]):
            del words[0]
        end = next((place for place, word in enumerate(words) if word in ENDS), len(words))
        words = [word.removesuffix(";") for word in words[:end]]
        if words:
            yield [words[0].removeprefix(".venv/bin/"), *words[1:]]


def why_wrong(words: list[str]) -> str | None:
    """What is wrong with a command; None for one that exists, and for what is none of the project's commands."""
    reasons: list[str | None]
    match words:
        case ["skymosaic", *rest]:
            return wrong_arguments(get_command(skymosaic), rest)
        case [command, _, *_] if command in COMMANDS:
            return wrong_arguments(get_command(skymosaic), words)
        case ["python" | "python3", "-m", module, *rest] if module.split(".")[0] in {"bench", "tools", "hdl", "tests"}:
            return wrong_module(module, rest)
        case ["python" | "python3", script, *_] if script.startswith(("bench/", "tools/")):
            reasons = [None if (ROOT / script).is_file() else "no such script"]
        case ["pip", "install", *rest]:
            reasons = [why_not_installable(word) for word in rest]
        case ["make", *rest]:
            reasons = [None if in_makefile(word) else f"no {word} in the Makefile" for word in rest]
        case ["pytest", *rest]:
            paths = [word.split("::")[0] for word in rest if word.startswith("tests/")]
            reasons = [None if (ROOT / path).exists() else f"no {path}" for path in paths]
        case _:
            reasons = []
    return next(filter(None, reasons), None)


def why_not_installable(word: str) -> str | None:
    """What is wrong with an argument of ``pip install``: the project is on no index, and an extra must exist."""
    package, bracket, extras = word.rstrip("]").partition("[")
    if package == "skymosaic":
        return "on no package index"
    unknown = set(extras.split(",")) - EXTRAS if bracket and package in {".", ""} else set()
    return f"no extra {', '.join(unknown)}" if unknown else None


def in_makefile(word: str) -> bool:
    """Whether a word is a target, or an assignment to one of the variables."""
    name, equals, _ = word.partition("=")
    pattern = rf"^{re.escape(name)} ?(\?=|:=)" if equals else rf"^{re.escape(name)}:"
    return re.search(pattern, MAKEFILE, re.MULTILINE) is not None


def wrong_module(module: str, rest: list[str]) -> str | None:
    """What is wrong with ``python -m module rest``."""
    try:
        if importlib.util.find_spec(module) is None:
            return "no such module"
    except ModuleNotFoundError:
        return "no such module"
    options = [word for word in rest if word.startswith("-")]
    imported = importlib.import_module(module)
    program = getattr(imported, "app", None)
    if "typer.run(main)" in inspect.getsource(imported):
        program = typer.Typer()
        program.command()(imported.main)
    if isinstance(program, typer.Typer):
        return wrong_arguments(get_command(program), rest)
    return f"{module} takes no options that can be checked" if options else None


def wrong_arguments(command: Any, words: list[str]) -> str | None:
    """What the parser of a Typer command refuses."""
    try:
        while True:
            context = command.context_class(command)
            _, words, _ = command.make_parser(context).parse_args(list(words))
            if not hasattr(command, "resolve_command") or not words or not re.fullmatch("[a-z_-]+", words[0]):
                return None
            _, command, words = command.resolve_command(context, words)
    except USAGE_ERROR as error:
        message = error.format_message()
        # "`skymosaic export block` writes ..." names the option alone.
        return None if "requires an argument" in message else message


def test_every_quoted_command_exists() -> None:
    commands: dict[tuple[str, ...], Path] = {}
    for path in [*PAGES, *SOURCES]:
        pattern = f"{SPAN}|{BLOCK_LINE}" if path.suffix == ".md" else SPAN
        # What the changelog names there is no more.
        text, _, _ = path.read_text(encoding="utf-8").partition("### Taken out")
        found = quoted(text, pattern)
        commands |= {tuple(words): path.relative_to(ROOT) for words in found}
    for path in ROOT.glob("docs/measured/*.json"):
        commands[tuple(shlex.split(json.loads(path.read_text(encoding="utf-8"))["command"]))] = path.relative_to(ROOT)
    wrong = [f"{path}: {' '.join(words)}: {why}" for words, path in commands.items() if (why := why_wrong(list(words)))]
    assert not wrong, "\n".join(wrong)
    ours = [words for words in commands if words[0] in {"skymosaic", "python", "make"}]
    assert len(ours) > 60


def test_tables_of_the_readme_are_the_measured_ones() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    tables = re.findall(r"<!-- measured: (\w+) -->\n((?:\|.*\n)+)", text)
    assert tables
    for name, shown in tables:
        heading, _, *rows = cells(shown)
        known_heading, _, *known = cells(table(name))
        columns = [known_heading.index(column) for column in heading]
        measured = {row[0]: [row[column] for column in columns] for row in known}
        for row in rows:
            assert row == measured[row[0]]


def cells(markdown: str) -> list[list[str]]:
    """Rows of a table, without bold type."""
    lines = [line.replace("\N{NO-BREAK SPACE}", " ") for line in markdown.splitlines() if line.startswith("|")]
    return [[cell.strip(" *") for cell in line.strip("|").split("|")] for line in lines]
