"""Makes the pictures for docs/how-to/panel.md: ``python -m tools.panel.screenshots [FOLDER]``."""

import tempfile
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from playwright.sync_api import Page, expect

from tools.panel.visit import (
    chromium,
    load_built_in_pair,
    make_mosaic,
    middle_of,
    open_page,
    open_tab,
    photographs_loaded,
    running_panel,
)

QUALITY = 60
SETTLED_MS = 300
"""Time for pictures to be loaded."""


def shoot(page: Page, folder: Path, name: str, *, whole_page: bool = False) -> None:
    """Save the window, or all that it can be scrolled to, as ``NAME.webp``."""
    page.wait_for_timeout(SETTLED_MS)
    pixels = cv2.imdecode(np.frombuffer(page.screenshot(full_page=whole_page), np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(folder / f"{name}.webp"), pixels, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])


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
    page.get_by_role("button", name="Load the built-in flight").click()
    expect(photographs_loaded(page)).to_have_count(9)
    make_mosaic(page)
    page.get_by_role("switch", name="Outlines").click()
    shoot(page, folder, "panel-flight")


def visit_tracking(page: Page, folder: Path) -> None:
    """Track the car through the built-in film."""
    page.get_by_role("link", name="Tracking").click()
    page.get_by_role("button", name="Try the built-in film").click()
    expect(page.get_by_role("list", name="Video loaded").locator("li")).to_have_count(1)
    page.get_by_role("button", name="Follow the object").click()
    expect(page.get_by_text("Found in")).to_be_visible()
    shoot(page, folder, "panel-tracking")


def show_pages(
    folder: Annotated[Path, typer.Argument(help="Where the pictures are written.")] = Path("docs/images"),
) -> None:
    """Make every picture with one browser."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as log_folder, running_panel(Path(log_folder)) as address, chromium() as browser:
        for visit in (visit_pair, visit_flight, visit_tracking):
            page = open_page(browser, address, color_scheme="light")
            visit(page, folder)
            page.context.close()


if __name__ == "__main__":
    typer.run(show_pages)
