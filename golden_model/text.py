"""Texts of messages: outside text (file names, a peer's messages) made safe to print, and common advice."""

import importlib
import json
import os
import shlex
import sys
import unicodedata

_UNSAFE = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Unicode categories that end a line, move the cursor, reverse the direction of writing, or cannot be encoded."""
MAX_LENGTH = 2000


def one_line(text: str) -> str:
    r"""``text`` on one line: control characters are written as ``\x1b`` and the like, and a long text is cut.

    Names of files may contain newlines and terminal sequences, which would forge or hide parts of a message.
    """
    # The middle goes: the beginning says what is wrong, and the names of two files differ at the end.
    return _escape(text if len(text) <= MAX_LENGTH else f"{text[: MAX_LENGTH // 2]} ... {text[-MAX_LENGTH // 2 :]}")


def encodable(text: str) -> str:
    """``text`` of several lines of any length, each made safe: names of files need not be text in UTF-8."""
    return "\n".join(map(_escape, text.split("\n")))


def _escape(line: str) -> str:
    if line.isprintable():  # quick, as for the pictures within a page
        return line
    return "".join(
        char.encode("unicode_escape").decode() if unicodedata.category(char) in _UNSAFE else char for char in line
    )


def how_to_install(extra: str) -> str:
    """Command that adds one of the extras of pyproject.toml. The package is on no index, so it names wheel or source.

    Outside an active environment (``.venv`` of ``make demo``, pipx), plain ``pip`` would be another one's: it is run by
    its Python.
    """
    is_active = sys.prefix == sys.base_prefix or os.environ.get("VIRTUAL_ENV") == sys.prefix
    pip = "pip" if is_active else f"{shlex.quote(sys.executable)} -m pip"
    # It takes as long to import as all of `skymosaic --version` otherwise.
    found = importlib.import_module("importlib.metadata").distributions(name="skymosaic")
    origin = json.loads(next((each.read_text("direct_url.json") for each in found), None) or "{}").get("url", "")
    if origin.endswith(".whl"):
        return f"run {pip} install {shlex.quote(f'skymosaic[{extra}] @ {origin}')}"
    return f"in the folder of the source, run {pip} install '.[{extra}]'"
