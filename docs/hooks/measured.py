"""Tables that a bench has measured: a link to a file of ``docs/measured`` that stands alone becomes its table.

Where pages are read without the site, the link leads to the figures. A link's title chooses rows by their first cell:
``[Area](../measured/synthesis.json "gray; half")``.
"""

import json
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

MEASURED = Path(__file__).parents[1] / "measured"
LINK = re.compile(r'^\[[^\]]+\]\((?:\S+/)?measured/(?P<name>\w+)\.json(?: "(?P<rows>[^"]+)")?\)$', re.MULTILINE)
NOT_SHOWN = ("digest", "yosys")
"""Columns that say what was measured."""
SEPARATED_FROM = 10_000
"""Integers from here on are written with commas."""


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Put the tables in place."""
    return LINK.sub(lambda link: table(link["name"], link["rows"]), markdown)


def table(name: str, chosen: str | None = None) -> str:
    """A file as a Markdown table with the command that measured it below.

    Raises
    ------
    ValueError
        If a chosen row is not in the file.
    """
    measured = json.loads((MEASURED / f"{name}.json").read_text(encoding="utf-8"))
    rows = measured["rows"]
    if chosen:
        named = {str(next(iter(row.values()))): row for row in rows}
        wanted = chosen.split("; ")
        if unknown := [row for row in wanted if row not in named]:
            raise ValueError(f"{name}.json has no row {', '.join(unknown)}; it has {', '.join(named)}")
        rows = [named[row] for row in wanted]
    columns = [column for column in rows[0] if column not in NOT_SHOWN]
    is_numeric = [all(isinstance(row[column], int | float) for row in rows) for column in columns]
    lines = [columns, ["---:" if numeric else "---" for numeric in is_numeric]]
    for above, row in zip([{}, *rows], rows, strict=False):
        repeats = row[columns[0]] == above.get(columns[0])
        lines.append(["" if repeats else cell(row[columns[0]]), *(cell(row[column]) for column in columns[1:])])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + f"\n\n*Measured by* `{measured['command']}`."


def cell(value: Any) -> str:
    """A figure as it is written; those of one measure stay on one line."""
    if isinstance(value, int) and abs(value) >= SEPARATED_FROM:
        return f"{value:,}"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text.replace(" / ", "\N{NO-BREAK SPACE}/\N{NO-BREAK SPACE}").replace(" px", "\N{NO-BREAK SPACE}px")
