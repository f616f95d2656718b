"""Every state of the panel's pages, each reached from the one before."""

from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page, expect

from sim.scene import make_lawnmower
from skymosaic.imagery.images import save
from tests.skymosaic.panel.visitor import choose, open_tab, photographs_loaded
from tools.panel import load_built_in_pair, make_mosaic


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
