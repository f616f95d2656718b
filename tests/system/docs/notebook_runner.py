"""Runs the notebook made from a tutorial, as its reader would: by a Jupyter kernel, in a folder of its own."""

import os
import re
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from docs.hooks.notebooks import notebook
from tests.system.docs.page_runner import is_printed

COLOURS = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
"""Sequences by which a command colours its output; a notebook shows them as colours."""


def run_notebook(page: Path, folder: Path, clone: Path) -> list[str]:
    """The cells of a page's notebook that print other than the page says, with what they print.

    Parameters
    ----------
    page : Path
        The tutorial.
    folder : Path
        Where the notebook is run.
    clone : Path
        Whose modules and command are run.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        If a cell raises an exception.
    """
    made = nbformat.reads(notebook(page.read_text(encoding="utf-8")), as_version=4)
    wanted = [_printed(cell) for cell in made.cells]
    environment = {
        **os.environ,
        "PYTHONPATH": str(clone),
        "PATH": os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"])),
        "IPYTHONDIR": str(folder / "ipython"),
    }
    client = NotebookClient(made, timeout=None, resources={"metadata": {"path": str(folder)}})
    client.execute(env=environment)
    return [
        f"{cell.source}\nexpected:\n{want}\ngot:\n{got}"
        for cell, want in zip(made.cells, wanted, strict=True)
        if cell.cell_type == "code" and not cell.source.startswith("%%writefile")
        if not is_printed(want, got := _printed(cell))
    ]


def _printed(cell: nbformat.NotebookNode) -> str:
    """What a cell prints, and the value of its last line."""
    texts = [output.get("text") or output["data"].get("text/plain", "") for output in cell.get("outputs", [])]
    return COLOURS.sub("", "\n".join(texts))
