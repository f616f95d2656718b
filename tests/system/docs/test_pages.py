"""What the tutorials and how-to pages show is what a reader gets."""

import sys
from pathlib import Path

import pytest

from tests.system.docs.page_runner import FENCE, run_page

DOCS = Path(__file__).parents[3] / "docs"
SLOW = {"change_a_rule.md", "export_to_a_kit.md", "flight_to_map.md", "fuzzy_systems.md", "own_rules.md"}
"""Pages whose commands take seconds to start, or write the Verilog of a whole accelerator."""
TUTORIALS = 8
RUN = {"pycon", "console"}
"""Languages of the blocks that are run."""


def with_blocks_to_run() -> list[Path]:
    pages = sorted([*DOCS.glob("tutorials/*.md"), *DOCS.glob("how-to/*.md")])
    return [page for page in pages if RUN & {fence["language"] for fence in FENCE.finditer(page.read_text())}]


def tutorials() -> list[Path]:
    return sorted(page for page in DOCS.glob("tutorials/*.md") if page.name != "index.md")


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, id=page.stem, marks=[pytest.mark.slow] * (page.name in SLOW)) for page in with_blocks_to_run()],
)
def test_the_page_prints_what_it_shows(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    # A command in a page must find the modules of this clone, not of an installed one.
    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))
    before = set(sys.modules)
    assert run_page(page) > 0
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def test_every_tutorial_is_run() -> None:
    assert len(tutorials()) == TUTORIALS
    assert set(tutorials()) <= set(with_blocks_to_run())


def test_a_wrong_output_fails(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```pycon\n>>> 1 + 1\n3\n\n```\n")
    with pytest.raises(AssertionError, match=r"Expected:\n\s+3\nGot:\n\s+2"):
        run_page(page)
