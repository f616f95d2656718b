"""The mosaic page as a user sees it, with more than two photographs."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.skymosaic.panel.visitor import names_reached_by_tab, repeat_archive
from tools.panel.visit import (
    choose,
    corner_counts,
    make_mosaic,
    mosaic_viewer,
    open_page,
    open_tab,
    photographs_loaded,
)

PHOTOGRAPHS = 9


@pytest.fixture(scope="module")
def flight(browser: Browser, panel: str) -> Iterator[Page]:
    """A page of a session that has made the mosaic of the built-in flight."""
    page = open_page(browser, panel)
    page.get_by_role("button", name="Load the built-in flight").click()
    expect(photographs_loaded(page)).to_have_count(PHOTOGRAPHS)
    make_mosaic(page)
    yield page
    page.context.close()


def test_a_flight_becomes_one_mosaic(flight: Page) -> None:
    expect(flight.get_by_text(f"{PHOTOGRAPHS} photographs", exact=True)).to_be_visible()
    expect(flight.get_by_role("tabpanel", name="Mosaic")).to_contain_text(f"{PHOTOGRAPHS} photographs")
    flight.get_by_role("switch", name="Outlines").click()
    expect(mosaic_viewer(flight).locator("polygon")).to_have_count(PHOTOGRAPHS)
    flight.get_by_role("switch", name="Seams").click()
    expect(mosaic_viewer(flight).locator("path.seam")).to_have_count(1)
    open_tab(flight, "Numbers")
    expect(flight.get_by_role("tabpanel", name="Numbers")).to_contain_text(f"{PHOTOGRAPHS} of {PHOTOGRAPHS}")


def test_the_matches_of_any_pair_of_a_flight_can_be_shown(flight: Page) -> None:
    open_tab(flight, "Matches")
    panel = flight.get_by_role("tabpanel", name="Matches")
    before = panel.locator("image").last.get_attribute("href")
    flight.get_by_role("combobox", name="Pair of the flight").click()
    flight.get_by_role("option").last.click()
    flight.get_by_role("button", name="Look at it").click()
    expect(panel.locator("image").last).not_to_have_attribute("href", before)
    flight.get_by_role("button", name="Next match").click()
    expect(flight.locator(".explanation")).to_contain_text("px from the homography")
    open_tab(flight, "Mosaic")
    expect(mosaic_viewer(flight)).to_be_visible()


def test_tab_reaches_the_controls_of_a_flight(flight: Page) -> None:
    open_tab(flight, "Matches")
    assert {"Pair of the flight", "Look at it", "Remove all"} <= set(names_reached_by_tab(flight))


@pytest.mark.slow
def test_the_command_of_a_flight_repeats_its_mosaic(flight: Page, tmp_path: Path) -> None:
    again = repeat_archive(flight, tmp_path, "mosaic")
    assert (again / "report" / "index.html").exists()
    first, second = (np.asarray(cv2.imread(str(folder / "mosaic.png"))) for folder in (again, tmp_path / "before"))
    assert np.array_equal(first, second)


def test_options_that_a_flight_cannot_have_are_refused_with_a_reason(flight: Page) -> None:
    choose(flight, "Detector", "orb")
    expect(flight.get_by_text("more than two photographs take Harris or FAST")).to_be_visible()
    expect(flight.get_by_role("button", name="Make the mosaic")).to_be_disabled()
    choose(flight, "Preset", "aerial")
    choose(flight, "Detector", "harris")
    expect(flight.get_by_role("button", name="Make the mosaic")).to_be_enabled()


def test_the_mosaic_stays_when_photographs_are_removed(flight: Page) -> None:
    photographs_loaded(flight).first.get_by_role("button").click()
    expect(photographs_loaded(flight)).to_have_count(PHOTOGRAPHS - 1)
    flight.get_by_role("button", name="Remove all").click()
    expect(photographs_loaded(flight)).to_have_count(0)
    expect(corner_counts(flight)).to_have_count(0)
    flight.reload()
    expect(mosaic_viewer(flight)).to_be_visible()
    open_tab(flight, "Matches")
    shown = flight.get_by_role("tabpanel", name="Matches").locator("image").first.get_attribute("href")
    assert flight.evaluate("address => fetch(address).then(answer => answer.status)", shown) == 200
