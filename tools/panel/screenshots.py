"""Makes the pictures for docs/how-to/panel.md, or pictures of every state of the pages.

    python -m tools.panel.screenshots [FOLDER]
    python -m tools.panel.screenshots --states FOLDER

The second shows every state in a small window, in a large one and on a phone, in light and dark: to be looked at after
a change of the style.
"""

import tempfile
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
import typer
from playwright.sync_api import Browser, Page, ViewportSize, expect

from tools.panel.states import LONG_STATES, OWNER_STATES, STATES, write_flight
from tools.panel.visit import (
    PHONE,
    WINDOW,
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
SIZES: tuple[ViewportSize, ...] = (WINDOW, {"width": 1920, "height": 1080}, PHONE)
SCHEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")
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


def show_pages(folder: Path) -> None:
    """Make every picture with one browser."""
    with tempfile.TemporaryDirectory() as log_folder, running_panel(Path(log_folder)) as address, chromium() as browser:
        for visit in (visit_pair, visit_flight, visit_tracking):
            page = open_page(browser, address, color_scheme="light")
            visit(page, folder)
            page.context.close()


def show_states(folder: Path) -> None:
    """Save ``STATE-WIDTH-SCHEME.webp`` for every state, size of the window and colour scheme."""
    with tempfile.TemporaryDirectory() as log_folder, chromium() as browser:
        write_flight(Path(log_folder) / "flight")
        with running_panel(Path(log_folder), "--root", "flight") as address:
            shoot_states(browser, address, folder)


def shoot_states(browser: Browser, address: str, folder: Path) -> None:
    """Save the pictures of one panel's states."""
    for states in (STATES, LONG_STATES, OWNER_STATES):
        page = open_page(browser, address)
        for name, reach in states.items():
            reach(page)
            for scheme in SCHEMES:
                page.emulate_media(color_scheme=scheme)
                for size in SIZES:
                    page.set_viewport_size(size)
                    shoot(page, folder, f"{name.replace(' ', '_')}-{size['width']}-{scheme}", whole_page=True)
            page.emulate_media(color_scheme="light")
            page.set_viewport_size(WINDOW)
        page.context.close()


def main(
    folder: Annotated[Path, typer.Argument(help="Where the pictures are written.")] = Path("docs/images"),
    states: Annotated[bool, typer.Option("--states", help="Every state in every window, light and dark.")] = False,
) -> None:
    """Make the pictures of the documentation, or of every state."""
    folder.mkdir(parents=True, exist_ok=True)
    (show_states if states else show_pages)(folder)


app = typer.Typer(add_completion=False)
app.command()(main)

if __name__ == "__main__":
    app()
