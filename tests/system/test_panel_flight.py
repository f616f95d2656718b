"""The mosaic page as a user sees it, with more than two photographs: those of a folder of the panel's machine."""

import os
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from sim.scene import make_lawnmower
from tests.skymosaic.panel.visitor import open_tab, photographs_loaded, repeat_archive
from tools.panel import corner_counts, make_mosaic, mosaic_viewer

PHOTOGRAPHS = 8


@pytest.fixture(scope="module")
def folder(root: Path) -> Path:
    """A flight in the root, whose first photograph's name asks to be escaped."""
    flight = root / "a flight"
    flight.mkdir()
    for number, image in enumerate(make_lawnmower(9, PHOTOGRAPHS, (400, 300)).images):
        path = flight / f"IMG {number} <b> & '\".png"
        cv2.imwrite(str(path), image)
        os.utime(path, (0, 0))
    return flight


@pytest.fixture(scope="module")
def owner(opened: Page, owner_address: str) -> Page:
    """The opened page, by the address that the panel printed."""
    opened.goto(owner_address)
    return opened


@pytest.fixture(scope="module")
def flight(owner: Page, panel: str, folder: Path) -> Page:
    """The same page, which has made the mosaic of a folder that was browsed."""
    expect(owner).to_have_url(f"{panel}/")
    if not owner.get_by_role("textbox", name="Folder").is_visible():
        owner.get_by_role("button", name="Open a folder").click()
    owner.get_by_role("button", name=folder.name).click()
    expect(owner.get_by_role("textbox", name="Folder")).to_have_value(str(folder))
    owner.get_by_role("button", name="Open", exact=True).click()
    expect(photographs_loaded(owner).locator("img")).to_have_count(PHOTOGRAPHS)
    make_mosaic(owner)
    return owner


def test_a_folder_is_read_in_place(flight: Page, folder: Path, tmp_path: Path) -> None:
    flight.wait_for_function("[...document.querySelectorAll('.tile img')].every(img => img.naturalWidth > 0)")
    address = photographs_loaded(flight).locator("img").first.get_attribute("src")
    assert flight.evaluate("address => fetch(address).then(answer => answer.status)", address) == 200
    with flight.expect_download() as download:
        flight.get_by_role("link", name="Download everything").click()
    download.value.save_as(tmp_path / "all.zip")
    with zipfile.ZipFile(tmp_path / "all.zip") as archive:
        names = archive.namelist()
        command = archive.read("mosaic/command.txt").decode()
    assert not any("IMG" in name for name in names), "photographs were copied"
    assert f"mosaic '{folder}' --config" in command


def test_a_flight_becomes_one_mosaic(flight: Page) -> None:
    expect(flight.get_by_text(f"{PHOTOGRAPHS} photographs", exact=True)).to_be_visible()
    expect(flight.get_by_role("tabpanel", name="Mosaic")).to_contain_text(f"{PHOTOGRAPHS} photographs")
    flight.get_by_role("switch", name="Outlines").click()
    expect(mosaic_viewer(flight).locator("polygon")).to_have_count(PHOTOGRAPHS)
    flight.get_by_role("switch", name="Seams").click()
    expect(mosaic_viewer(flight).locator("path.seam")).to_have_count(1)
    open_tab(flight, "Numbers")
    expect(flight.get_by_role("tabpanel", name="Numbers")).to_contain_text(f"{PHOTOGRAPHS} of {PHOTOGRAPHS}")


@pytest.mark.slow
def test_the_command_of_a_flight_repeats_its_mosaic(flight: Page, tmp_path: Path) -> None:
    again = repeat_archive(flight, tmp_path, "mosaic")
    assert (again / "report" / "index.html").exists()
    first, second = (np.asarray(cv2.imread(str(folder / "mosaic.png"))) for folder in (again, tmp_path / "before"))
    assert np.array_equal(first, second)


def test_the_mosaic_and_the_folder_stay_when_photographs_are_removed(flight: Page, folder: Path) -> None:
    photographs_loaded(flight).first.get_by_role("button").click()
    expect(photographs_loaded(flight)).to_have_count(PHOTOGRAPHS - 1)
    flight.get_by_role("button", name="Remove all").click()
    expect(photographs_loaded(flight)).to_have_count(0)
    assert [path.stat().st_mtime_ns for path in folder.iterdir()] == [0] * PHOTOGRAPHS
    expect(corner_counts(flight)).to_have_count(0)
    flight.reload()
    expect(mosaic_viewer(flight)).to_be_visible()
    open_tab(flight, "Matches")
    shown = flight.get_by_role("tabpanel", name="Matches").locator("image").first.get_attribute("href")
    assert flight.evaluate("address => fetch(address).then(answer => answer.status)", shown) == 200
