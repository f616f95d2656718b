"""Each tutorial as a Jupyter notebook, made from its page: the outputs are those of the page, which a test runs."""

import doctest
import re
from collections.abc import Iterator
from pathlib import PurePosixPath

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

FOLDER = "tutorials"
FENCE = re.compile(
    r"^```(?P<language>\w+)(?: title=\"(?P<title>[^\"]+)\")?\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL
)
"""A block of a page: with a title a file, otherwise ``pycon``, ``console`` with commands after ``$``, or text."""
_PAGE_LINK = re.compile(r"\[([^\]]+)\]\([^)\s]+\.md(?:#[^)]*)?\)")
_PARSER = doctest.DocTestParser()


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a notebook for each tutorial."""
    tutorials = [file for file in files.documentation_pages() if _is_tutorial(file)]
    for file in tutorials:
        files.append(File.generated(config, _notebook_of(file), content=notebook(file.content_string)))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Offer the notebook below the page's title."""
    if not _is_tutorial(page.file):
        return markdown
    name = PurePosixPath(_notebook_of(page.file)).name
    title, text = markdown.split("\n", 1)
    return f'{title}\n\n[This page as a Jupyter notebook]({name}){{: download="{name}" }}\n{text}'


def _is_tutorial(file: File) -> bool:
    return file.src_uri.startswith(f"{FOLDER}/") and file.name != "index"


def _notebook_of(file: File) -> str:
    return str(PurePosixPath(file.src_uri).with_suffix(".ipynb"))


def notebook(page: str) -> str:
    """A page as a notebook: its text, its files, and its code and commands with what they print."""
    cells = list(_cells(page))
    for number, cell in enumerate(cells):
        cell.id = f"cell-{number}"
    made = new_notebook(cells=cells, metadata={"language_info": {"name": "python"}})
    nbformat.validate(made)
    return nbformat.writes(made) + "\n"


def _cells(page: str) -> Iterator[nbformat.NotebookNode]:
    end = 0
    for fence in FENCE.finditer(page):
        if text := page[end : fence.start()].strip():
            yield _text_cell(text)
        end = fence.end()
        if fence["title"]:
            yield new_code_cell(f"%%writefile {fence['title']}\n{fence['body'].rstrip()}")
        elif fence["language"] == "pycon":
            yield from _python_cells(fence["body"])
        elif fence["language"] == "console":
            for command in re.split(r"^\$ ", fence["body"], flags=re.MULTILINE)[1:]:
                line, _, printed = command.partition("\n")
                yield _code_cell(f"!{line}", printed)
        else:
            yield _text_cell(fence[0])
    if text := page[end:].strip():
        yield _text_cell(text)


def _python_cells(body: str) -> Iterator[nbformat.NotebookNode]:
    """A cell ends where something is printed: a notebook shows the value of a cell's last line only."""
    lines = ""
    for example in _PARSER.get_examples(body):
        lines += example.source
        if example.want:
            yield _code_cell(lines, example.want)
            lines = ""
    if lines:
        yield _code_cell(lines, "")


def _text_cell(text: str) -> nbformat.NotebookNode:
    # A notebook lies alone in the reader's folder: links to other pages would lead nowhere.
    return new_markdown_cell(_PAGE_LINK.sub(r"\1", text))


def _code_cell(source: str, printed: str) -> nbformat.NotebookNode:
    outputs = [new_output("stream", text=printed.rstrip("\n") + "\n")] if printed.strip() else []
    return new_code_cell(source.rstrip("\n"), outputs=outputs)
