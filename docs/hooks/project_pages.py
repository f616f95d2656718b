"""Pages of the site that are files at the repository's top: README is the first page, so nothing is written twice."""

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

TOP = Path(__file__).parents[2]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CODE_OF_CONDUCT.md": "code_of_conduct.md",
    "SECURITY.md": "security.md",
    "CHANGELOG.md": "changelog.md",
}
"""Each file at the top, and its page."""
_FROM_TOP = re.compile(r"\]\((?:docs/)?(?P<path>[^):#]+\.\w+)(?P<anchor>#[^)]*)?\)")
_TO_TOP = re.compile(r"\]\((?:\.\./)+(?P<name>[A-Z_]+\.md)(?P<anchor>#[^)]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages, with links as they are from inside ``docs/``."""
    for name, page in PAGES.items():
        text = _FROM_TOP.sub(_from_docs, (TOP / name).read_text(encoding="utf-8"))
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point links to a file at the top to its page."""
    up = "../" * page.file.src_uri.count("/")
    return _TO_TOP.sub(lambda link: f"]({up}{PAGES[link['name']]}{link['anchor'] or ''})", markdown)


def _from_docs(link: re.Match[str]) -> str:
    return f"]({PAGES.get(link['path'], link['path'])}{link['anchor'] or ''})"
