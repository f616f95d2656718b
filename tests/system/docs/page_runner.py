"""Runs a page of the documentation as its reader would: files, Python and commands, in the order of the page."""

import doctest
import re
import shlex
import subprocess
import sys
from pathlib import Path

FENCE = re.compile(
    r"^```(?P<language>\w+)(?: title=\"(?P<title>[^\"]+)\")?\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL
)
"""A block of a page: with a title a file, otherwise ``pycon``, ``console`` with commands after ``$``, or text."""
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def run_page(page: Path) -> int:
    """Run the blocks of a page in the current folder, and return how many outputs were compared.

    A block with a title is written to a file of that name; ``pycon`` blocks share their variables; a ``console`` block
    holds commands of skymosaic after ``$``, each with its output. ``...`` stands for any text.

    Raises
    ------
    AssertionError
        With what was expected and what came instead.
    """
    names: dict[str, object] = {}
    compared = 0
    text = page.read_text(encoding="utf-8")
    for fence in FENCE.finditer(text):
        body, line = fence["body"], text.count("\n", 0, fence.start()) + 1
        if fence["title"]:
            Path(fence["title"]).write_text(body, encoding="utf-8")
        elif fence["language"] == "pycon":
            compared += _run_python(body, names, page, line)
        elif fence["language"] == "console":
            compared += _run_commands(body, f"{page.name}, line {line}")
    return compared


def _run_python(body: str, names: dict[str, object], page: Path, line: int) -> int:
    test = doctest.DocTestParser().get_doctest(body, names, page.name, str(page), line)
    report: list[str] = []
    results = doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=report.append, clear_globs=False)
    assert not results.failed, "".join(report)
    # Names that one block defines are used by the next ones.
    names.update(test.globs)
    return sum(bool(example.want) for example in test.examples)


def _run_commands(body: str, where: str) -> int:
    commands = re.split(r"^\$ ", body, flags=re.MULTILINE)[1:]
    for command in commands:
        line, _, expected = command.partition("\n")
        program, *arguments = shlex.split(line)
        assert program == "skymosaic", f"{where}: only commands of skymosaic are run, not {program}"
        done = subprocess.run(
            [sys.executable, "-m", "skymosaic", *arguments],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{where}: {line}\nexit status {done.returncode}\n{done.stdout}"
        assert is_printed(expected, done.stdout), f"{where}: {line}\nexpected:\n{expected}\ngot:\n{done.stdout}"
    return len(commands)


def is_printed(expected: str, printed: str) -> bool:
    """Whether a text is what a page says, where ``...`` stands for any text and white space does not count."""
    pattern = ".*".join(re.escape(_one_line(part)) for part in expected.split("..."))
    return re.fullmatch(pattern, _one_line(printed)) is not None


def _one_line(text: str) -> str:
    return " ".join(text.split())
