"""Makes the pictures for docs/how-to/panel.md: ``python -m tests.skymosaic.panel.screenshots [FOLDER]``."""

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Page, expect

from tests.skymosaic.panel.states import flight, tracked
from tests.skymosaic.panel.visitor import middle_of, open_tab
from tools.panel import chromium, load_built_in_pair, make_mosaic, open_page, running_panel

WEBP_QUALITY = 60
SETTLED_MS = 300
"""Time for pictures to be loaded."""


def shoot(page: Page, folder: Path, name: str) -> None:
    """Save the window as ``NAME.webp``."""
    page.wait_for_timeout(SETTLED_MS)
    pixels = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(folder / f"{name}.webp"), pixels, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])


def visit_pair(page: Page, folder: Path) -> None:
    """Make the built-in pair's mosaic, show its matches and compare with the hardware."""
    load_built_in_pair(page)
    make_mosaic(page)
    shoot(page, folder, "panel-mosaic")
    open_tab(page, "Matches")
    page.get_by_role("checkbox", name="kept, on the homography").click()
    page.get_by_role("checkbox", name="rejected by the rules").click()
    viewer = page.get_by_role("group", name="Matches between the photographs")
    viewer.locator("> svg").hover()
    page.mouse.click(*middle_of(viewer.locator("path.match.rejected:not(.chosen)").first))
    page.get_by_role("checkbox", name="kept, on the homography").click()
    shoot(page, folder, "panel-matches")
    open_tab(page, "Hardware")
    page.get_by_role("button", name="Compare with the golden model").click()
    expect(page.get_by_text("Equal, bit for bit")).to_be_visible()
    shoot(page, folder, "panel-hardware")


def visit_flight(page: Page, folder: Path) -> None:
    """Make the built-in flight's mosaic and show the outlines."""
    flight(page)
    page.get_by_role("switch", name="Outlines").click()
    shoot(page, folder, "panel-flight")


def visit_tracking(page: Page, folder: Path) -> None:
    """Track the car through the built-in film."""
    tracked(page)
    shoot(page, folder, "panel-tracking")


def show_pages(folder: Path) -> None:
    """Make every picture with one browser, those of each visit with a new panel."""
    with chromium() as browser:
        for visit in (visit_pair, visit_flight, visit_tracking):
            with tempfile.TemporaryDirectory() as log_folder, running_panel(Path(log_folder)) as address:
                page = open_page(browser, address, color_scheme="light")
                visit(page, folder)
                page.context.close()


if __name__ == "__main__":
    pictures = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images")
    pictures.mkdir(parents=True, exist_ok=True)
    show_pages(pictures)
