"""The report beside a mosaic in a real browser: no barrier that axe-core finds, and it fits a phone."""

from pathlib import Path

import cv2
import pytest
from playwright.sync_api import Browser
from typer.testing import CliRunner

from sim.scene import make_lawnmower
from skymosaic.cli import app
from tests.system.test_panel_accessibility import barriers
from tools.panel.visit import PHONE, WINDOW


@pytest.mark.slow
@pytest.mark.parametrize("photographs", [2, 4])
def test_a_report_has_no_barriers(tmp_path: Path, browser: Browser, photographs: int) -> None:
    paths = [tmp_path / f"DJI_{number:04}.png" for number in range(photographs)]
    for path, image in zip(paths, make_lawnmower(9, photographs, (400, 300)).images, strict=True):
        cv2.imwrite(str(path), image)
    options = ["-o", str(tmp_path / "mosaic.png"), "--report", str(tmp_path / "report")]
    made = CliRunner().invoke(app, ["mosaic", *map(str, paths), *options])
    assert made.exit_code == 0, made.output
    found = []
    for window in (WINDOW, PHONE):
        for scheme in ("light", "dark"):
            page = browser.new_page(viewport=window, color_scheme=scheme)
            page.goto((tmp_path / "report" / "index.html").as_uri())
            found += barriers(page)
            width = page.evaluate("document.documentElement.scrollWidth")
            found += [f"{width} px wide"] if width > window["width"] else []
            page.close()
    assert found == []
