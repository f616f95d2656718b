"""Every state of the panel's pages, each reached from the one before.

``python -m tests.skymosaic.panel.states FOLDER`` shows all of them in a small window, in a large one and on a phone, in
light and dark: to be looked at after a change of the style.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from playwright.sync_api import Page, ViewportSize, expect

from sim.scene import make_lawnmower
from skymosaic.imagery.images import save
from tests.skymosaic.panel.visitor import choose, open_tab, photographs_loaded
from tools.panel import PHONE, WINDOW, chromium, load_built_in_pair, make_mosaic, open_page, running_panel

SIZES: tuple[ViewportSize, ...] = (WINDOW, {"width": 1920, "height": 1080}, PHONE)
SCHEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")
WEBP_QUALITY = 60
SETTLED_MS = 300
"""Time for pictures to be loaded."""


def shoot(page: Page, folder: Path, name: str, *, whole_page: bool = False) -> None:
    """Save the window, or all that it can be scrolled to, as ``NAME.webp``."""
    page.wait_for_timeout(SETTLED_MS)
    pixels = cv2.imdecode(np.frombuffer(page.screenshot(full_page=whole_page), np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(folder / f"{name}.webp"), pixels, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])


def welcome(page: Page) -> None:
    expect(page.get_by_role("button", name="Try the built-in pair")).to_be_visible()


def matches(page: Page) -> None:
    open_tab(page, "Matches")
    page.get_by_role("button", name="Next match").click()
    expect(page.locator(".explanation table.rules")).to_be_visible()


def rules_editor(page: Page) -> None:
    page.get_by_role("button", name="Edit the rules").click()
    page.get_by_role("slider", name="Corner 2 of distance: low, high").press("ArrowLeft")
    expect(page.get_by_role("button", name="Undo")).to_be_enabled()


def filled_window(page: Page) -> None:
    open_tab(page, "Mosaic")
    page.get_by_role("tabpanel", name="Mosaic").get_by_role("button", name="Fill the window").click()


def numbers(page: Page) -> None:
    page.keyboard.press("Escape")
    page.get_by_role("tabpanel", name="Mosaic").get_by_role("button", name="Fill the window").click()
    open_tab(page, "Numbers")


def refused_options(page: Page) -> None:
    choose(page, "Descriptor", "akaze")
    expect(page.get_by_role("option")).to_have_count(0)
    expect(page.get_by_text("the akaze descriptor needs akaze's own scale space")).to_be_visible()
    expect(page.get_by_role("button", name="Make the mosaic")).to_be_disabled()


def tracking(page: Page) -> None:
    page.get_by_role("link", name="Tracking").click()
    expect(page.get_by_role("button", name="Try the built-in film")).to_be_visible()


STATES: dict[str, Callable[[Page], None]] = {
    "welcome": welcome,
    "corners": load_built_in_pair,
    "mosaic": make_mosaic,
    "matches": matches,
    "rules editor": rules_editor,
    "filled window": filled_window,
    "numbers": numbers,
    "hardware": lambda page: open_tab(page, "Hardware"),
    "refused options": refused_options,
    "tracking": tracking,
}
"""States of a pair."""


def flight(page: Page) -> None:
    page.get_by_role("button", name="Load the built-in flight").click()
    expect(photographs_loaded(page)).to_have_count(9)
    make_mosaic(page)


def tracked(page: Page) -> None:
    tracking(page)
    page.get_by_role("button", name="Try the built-in film").click()
    expect(page.get_by_role("list", name="Video loaded").locator("li")).to_have_count(1)
    page.get_by_role("button", name="Follow the object").click()
    expect(page.get_by_text("Found in")).to_be_visible()


LONG_STATES: dict[str, Callable[[Page], None]] = {
    "flight": flight,
    "matches of a flight": matches,
    "numbers of a flight": lambda page: open_tab(page, "Numbers"),
    "tracked": tracked,
}
"""States of a flight and of a film, which take longer."""


def write_flight(folder: Path) -> None:
    """Make a folder of eight rendered photographs."""
    folder.mkdir()
    for number, image in enumerate(make_lawnmower(3, 8, (400, 300)).images):
        save(folder / f"DJI_{number:04}.png", image)


def folder_picker(page: Page) -> None:
    page.get_by_role("button", name="Open a folder").click()
    expect(page.get_by_role("textbox", name="Folder")).not_to_have_value("")


def refused_folder(page: Page) -> None:
    page.get_by_role("textbox", name="Folder").fill("/")
    page.get_by_role("button", name="Open", exact=True).click()
    expect(page.get_by_text("outside of what this panel may open")).to_be_visible()


def opened_folder(page: Page) -> None:
    page.get_by_role("textbox", name="Folder").fill("")
    page.get_by_role("button", name="Open", exact=True).click()
    expect(photographs_loaded(page).first).to_be_visible()


def finished_runs(page: Page) -> None:
    make_mosaic(page)
    page.get_by_role("link", name="Runs").click()
    page.get_by_role("button", name="Delete").first.click()
    expect(page.get_by_role("button", name="Delete for good")).to_be_visible()


FOLDER_STATES: dict[str, Callable[[Page], None]] = {
    "folder picker": folder_picker,
    "refused folder": refused_folder,
    "opened folder": opened_folder,
    "finished runs": finished_runs,
}
"""States of folders and runs; the panel's root is that of `write_flight`."""


def show_states(folder: Path) -> None:
    """Save ``STATE-WIDTH-SCHEME.webp`` for every state, size of the window and colour scheme."""
    with chromium() as browser:
        for states in (STATES, LONG_STATES, FOLDER_STATES):
            with tempfile.TemporaryDirectory() as log_folder:
                write_flight(Path(log_folder) / "flight")
                with running_panel(Path(log_folder), "--root", "flight") as address:
                    shoot_states(open_page(browser, address), states, folder)


def shoot_states(page: Page, states: dict[str, Callable[[Page], None]], folder: Path) -> None:
    """Save the pictures of a new panel's states."""
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


if __name__ == "__main__":
    pictures = Path(sys.argv[1])
    pictures.mkdir(parents=True, exist_ok=True)
    show_states(pictures)
