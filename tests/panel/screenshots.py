"""Makes the pictures for docs/panel.md and measures how long a user waits.

    python -m tests.panel.screenshots [FOLDER]

Prints the seconds from the command to its address and from the open page to the first mosaic, and the milliseconds from
a move of the threshold to the redrawn corners.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Page, expect

from tests.panel.visit import (
    WINDOW,
    chromium,
    load_built_in_pair,
    make_mosaic,
    middle_of,
    open_tab,
    photographs_loaded,
    running_panel,
    threshold_to_corners_ms,
)

ROUNDS = 20
QUALITY = 60
SETTLED_MS = 800
"""Time for animations to end and the pointer's colour to fade."""


def shoot(page: Page, folder: Path, name: str) -> None:
    """Save the window as ``panel-NAME.webp``."""
    page.wait_for_timeout(SETTLED_MS)
    pixels = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(folder / f"panel-{name}.webp"), pixels, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])


def visit_pair(page: Page, folder: Path) -> None:
    """Make the built-in pair's mosaic, show its matches and compare with the hardware."""
    started = time.perf_counter()
    load_built_in_pair(page)
    make_mosaic(page)
    print(f"open page to first mosaic: {time.perf_counter() - started:.1f} s")
    shoot(page, folder, "mosaic")
    open_tab(page, "Matches")
    page.get_by_role("checkbox", name="kept, on the homography").click()
    page.get_by_role("checkbox", name="rejected by the rules").click()
    viewer = page.get_by_role("group", name="Matches between the photographs")
    viewer.locator("> svg").hover()
    page.mouse.click(*middle_of(viewer.locator("path.match.rejected:not(.chosen)")))
    page.get_by_role("checkbox", name="kept, on the homography").click()
    shoot(page, folder, "matches")
    open_tab(page, "Hardware")
    page.get_by_role("button", name="Compare with the golden model").click()
    expect(page.get_by_text("Equal, bit for bit")).to_be_visible()
    shoot(page, folder, "hardware")


def move_threshold(page: Page, _: Path) -> None:
    """Measure how soon the corners follow the threshold."""
    load_built_in_pair(page)
    milliseconds = threshold_to_corners_ms(page, ROUNDS)
    print(f"threshold to corners: median {statistics.median(milliseconds):.0f} ms, worst {max(milliseconds):.0f} ms")


def visit_flight(page: Page, folder: Path) -> None:
    """Make the built-in flight's mosaic and show the outlines."""
    page.get_by_role("button", name="Load the built-in flight").click()
    expect(photographs_loaded(page)).to_have_count(9)
    make_mosaic(page)
    page.get_by_role("switch", name="Outlines").click()
    shoot(page, folder, "flight")


def visit_tracking(page: Page, folder: Path) -> None:
    """Track the car through the built-in film."""
    page.get_by_role("link", name="Tracking").click()
    page.get_by_role("button", name="Try the built-in film").click()
    expect(page.get_by_role("list", name="Video loaded").locator("li")).to_have_count(1)
    page.get_by_role("button", name="Follow the object").click()
    expect(page.get_by_text("Found in")).to_be_visible()
    shoot(page, folder, "tracking")


def main(folder: Path) -> None:
    """Make every picture with one browser."""
    folder.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as log_folder, running_panel(Path(log_folder)) as address, chromium() as browser:
        print(f"command to address, browser started: {time.perf_counter() - started:.1f} s")
        for visit in (visit_pair, move_threshold, visit_flight, visit_tracking):
            page = browser.new_page(viewport=WINDOW)
            page.goto(address)
            visit(page, folder)
            page.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/images"))
