"""Every state of the panel without barriers that axe-core finds, in light and dark, and without sideways scrolling."""

from collections.abc import Callable

import pytest
from axe_playwright_python.base import AXE_SCRIPT
from playwright.sync_api import Browser, Page, expect

from tests.panel.visit import (
    PHONE,
    WINDOW,
    load_built_in_pair,
    make_mosaic,
    open_page,
    open_tab,
    photographs_loaded,
)


def welcome(page: Page) -> None:
    expect(page.get_by_role("button", name="Try the built-in pair")).to_be_visible()


def matches(page: Page) -> None:
    open_tab(page, "Matches")
    page.get_by_role("button", name="Next match").click()
    expect(page.locator(".explanation table.rules")).to_be_visible()


def filled_window(page: Page) -> None:
    open_tab(page, "Mosaic")
    page.get_by_role("tabpanel", name="Mosaic").get_by_role("button", name="Fill the window").click()


def numbers(page: Page) -> None:
    page.keyboard.press("Escape")
    page.get_by_role("tabpanel", name="Mosaic").get_by_role("button", name="Fill the window").click()
    open_tab(page, "Numbers")


def refused_options(page: Page) -> None:
    page.get_by_role("combobox", name="Descriptor").click()
    page.get_by_role("option", name="freak", exact=True).click()
    expect(page.get_by_role("option")).to_have_count(0)
    page.get_by_role("combobox", name="Detector").click()
    page.get_by_role("option", name="orb", exact=True).click()


def tracking(page: Page) -> None:
    page.get_by_role("link", name="Tracking").click()
    expect(page.get_by_role("button", name="Try the built-in film")).to_be_visible()


STATES: dict[str, Callable[[Page], None]] = {
    "welcome": welcome,
    "corners": load_built_in_pair,
    "mosaic": make_mosaic,
    "matches": matches,
    "filled window": filled_window,
    "numbers": numbers,
    "hardware": lambda page: open_tab(page, "Hardware"),
    "options": refused_options,
    "tracking": tracking,
}
"""The states of a pair, each reached from the one before."""


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


def barriers(page: Page, *rules: str) -> list[str]:
    """What axe-core finds by its rules, or by some of them, as rule and element."""
    if page.evaluate("window.axe === undefined"):
        page.evaluate(AXE_SCRIPT)
    options = {"resultTypes": ["violations"], **({"runOnly": rules} if rules else {})}
    found = page.evaluate("async options => (await axe.run(options)).violations", options)
    return [f"{each['id']}: {node['html'][:200]}" for each in found for node in each["nodes"]]


def drawn(page: Page) -> None:
    """Wait until the page has drawn what was changed."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def walk(browser: Browser, panel: str, states: dict[str, Callable[[Page], None]]) -> list[str]:
    """Go through the states; returns the barriers of each, in light and dark, and where a phone scrolls sideways."""
    page = open_page(browser, panel, color_scheme="light")
    found = []
    for name, reach in states.items():
        reach(page)
        drawn(page)
        found += [f"{name}: {barrier}" for barrier in barriers(page)]
        page.emulate_media(color_scheme="dark")
        page.locator("body.body--dark").wait_for()
        found += [f"{name}, dark: {barrier}" for barrier in barriers(page, "color-contrast")]
        page.set_viewport_size(PHONE)
        drawn(page)
        width = page.evaluate("Math.max(document.documentElement.scrollWidth, document.body.scrollWidth)")
        found += [f"{name}: {width} px wide on a phone"] if width > PHONE["width"] else []
        page.emulate_media(color_scheme="light")
        page.set_viewport_size(WINDOW)
    page.context.close()
    return found


def test_the_states_of_a_pair_have_no_barriers(browser: Browser, panel: str) -> None:
    found = walk(browser, panel, STATES)
    assert found == [], "\n".join(found)


@pytest.mark.slow
def test_the_states_of_a_flight_and_a_film_have_no_barriers(browser: Browser, panel: str) -> None:
    found = walk(browser, panel, LONG_STATES)
    assert found == [], "\n".join(found)


def test_a_barrier_is_found(browser: Browser) -> None:
    page = browser.new_page()
    page.set_content('<html><body><main><button></button><p style="color: #ccc">pale</p></main></body></html>')
    assert {barrier.split(":")[0] for barrier in barriers(page)} >= {"button-name", "color-contrast", "html-has-lang"}
    page.close()
