"""Every state of the panel without barriers that axe-core finds, in light and dark, and without sideways scrolling."""

from collections.abc import Callable
from pathlib import Path

import pytest
from axe_playwright_python.base import AXE_SCRIPT
from playwright.sync_api import Browser, Page

from tools.panel.states import LONG_STATES, OWNER_STATES, STATES, write_flight
from tools.panel.visit import PHONE, WINDOW, open_page, running_panel


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


def keep_loading(page: Page) -> None:
    """Have a request under way that is never answered: what the page shows meanwhile must have no barriers either."""
    page.route("**/never-answered", lambda _route: None)
    page.evaluate("() => { const x = new XMLHttpRequest(); x.open('GET', '/never-answered'); x.send(); }")


def walk(browser: Browser, panel: str, states: dict[str, Callable[[Page], None]]) -> list[str]:
    """Go through the states; returns the barriers of each, in light and dark, and where a phone scrolls sideways."""
    page = open_page(browser, panel, color_scheme="light")
    keep_loading(page)
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


@pytest.mark.slow
def test_folders_and_runs_have_no_barriers(browser: Browser, tmp_path: Path) -> None:
    write_flight(tmp_path / "flight")
    with running_panel(tmp_path, "--root", "flight") as address:
        found = walk(browser, address, OWNER_STATES)
    assert found == [], "\n".join(found)


def test_a_barrier_is_found(browser: Browser) -> None:
    page = browser.new_page()
    page.set_content('<html><body><main><button></button><p style="color: #ccc">pale</p></main></body></html>')
    assert {barrier.split(":")[0] for barrier in barriers(page)} >= {"button-name", "color-contrast", "html-has-lang"}
    page.close()
