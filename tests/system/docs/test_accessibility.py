"""The site's home page in a real browser: no barrier that axe-core finds, and no sideways scrolling on a phone."""

import subprocess
import sys
from pathlib import Path

import pytest
from playwright.sync_api import Browser, ViewportSize

from tests.system.test_panel_accessibility import barriers
from tools.panel.visit import PHONE, WINDOW

TOP = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The address of the home page of the built site."""
    site = tmp_path_factory.mktemp("site")
    subprocess.run([sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", site], cwd=TOP, check=True)
    return (site / "index.html").as_uri()


@pytest.mark.slow
@pytest.mark.parametrize("window", [WINDOW, PHONE], ids=["window", "phone"])
def test_the_home_page_has_no_barriers(browser: Browser, home: str, window: ViewportSize) -> None:
    for scheme in ("light", "dark"):
        page = browser.new_page(viewport=window, color_scheme=scheme)
        page.goto(home)
        page.locator("nav.md-code__nav").first.wait_for(state="attached")
        assert barriers(page) == []
        assert page.evaluate("document.documentElement.scrollWidth") <= window["width"]
        page.close()
