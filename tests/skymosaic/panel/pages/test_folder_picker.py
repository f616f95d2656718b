"""A folder of the panel's machine, opened in headless Chromium: read in place, and only by who has the token."""

import shutil
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import httpx
import pytest
from nicegui import Client
from nicegui.page import page as nicegui_page
from playwright.sync_api import Page, expect

from sim.scene import make_lawnmower
from skymosaic.panel.folders import Roots
from skymosaic.panel.pages.folder_picker import FolderPicker
from tests.skymosaic.panel.visitor import Scenario, noise_png
from tools.panel.visit import corner_counts, make_mosaic, photographs_loaded

PHOTOGRAPHS = 8
MANY = 10_000


@pytest.fixture(scope="module")
def folder(root: Path) -> Path:
    """A flight in the root, whose first photograph's name asks to be escaped."""
    flight = root / "a flight"
    flight.mkdir()
    for number, image in enumerate(make_lawnmower(9, PHOTOGRAPHS, (400, 300)).images):
        cv2.imwrite(str(flight / f"IMG {number} <b> & '\".png"), image)
    return flight


@pytest.fixture
def owner(opened: Page, owner_address: str) -> Page:
    """A page that was opened by the address that the panel printed."""
    opened.context.clear_cookies()
    opened.goto(owner_address)
    return opened


def open_folder(page: Page, path: str) -> None:
    if not page.get_by_role("textbox", name="Folder").is_visible():
        page.get_by_role("button", name="Open a folder").click()
        expect(page.get_by_role("textbox", name="Folder")).not_to_have_value("")
    page.get_by_role("textbox", name="Folder").fill(path)
    page.get_by_role("button", name="Open", exact=True).click()


# It comes first: after the first test with a browser, no other event loop can run here.
def test_the_picker_shows_the_first_root_and_then_the_folder_that_was_shown(
    run_in_loop: Callable[[Scenario], None], tmp_path: Path
) -> None:
    for name in ("b", "A", "c/inside"):
        (tmp_path / "root" / name).mkdir(parents=True)
    session: Any = SimpleNamespace(roots=Roots([tmp_path / "root", tmp_path]))

    async def scenario() -> None:
        with Client(nicegui_page("/folders"), request=None):
            picker = FolderPicker(session)
        await picker._unfold()
        assert picker._path.value == "", "it is not unfolded"
        picker._expansion.value = True
        await picker._unfold()
        assert picker._path.value == str(tmp_path / "root")
        await picker._look("c")
        await picker._unfold()
        assert picker._path.value == str(tmp_path / "root" / "c")
        inside = [child for item in picker._folders.default_slot.children for child in item.default_slot.children]
        assert [getattr(button, "text", "") for button in inside] == ["the folder above", "inside"]
        await picker._look("absent")
        assert picker._fault.text == "absent: no such folder; check the path"
        await picker._look("A")
        assert picker._fault.text == ""

    run_in_loop(scenario)


def test_a_folder_is_browsed_opened_and_made_into_a_mosaic(
    owner: Page, panel: str, folder: Path, tmp_path: Path
) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    expect(owner).to_have_url(f"{panel}/")
    owner.get_by_role("button", name="Open a folder").click()
    owner.get_by_role("button", name=folder.name).click()
    expect(owner.get_by_role("textbox", name="Folder")).to_have_value(str(folder))
    owner.get_by_role("button", name="Open", exact=True).click()
    expect(photographs_loaded(owner)).to_have_count(PHOTOGRAPHS)
    expect(photographs_loaded(owner).locator("img")).to_have_count(PHOTOGRAPHS)
    owner.wait_for_function("[...document.querySelectorAll('.tile img')].every(img => img.naturalWidth > 0)")
    address = photographs_loaded(owner).locator("img").first.get_attribute("src")
    assert owner.evaluate("address => fetch(address).then(answer => answer.status)", address) == 200
    with httpx.Client(base_url=panel) as other:
        other.get("/")
        assert other.get(address or "").status_code == 404
    expect(corner_counts(owner)).to_contain_text("corners")
    make_mosaic(owner)
    with owner.expect_download() as download:
        owner.get_by_role("link", name="Download everything").click()
    download.value.save_as(tmp_path / "all.zip")
    with zipfile.ZipFile(tmp_path / "all.zip") as archive:
        names = archive.namelist()
        command = archive.read("mosaic/command.txt").decode()
    assert not any("IMG" in name for name in names), "photographs were copied"
    assert f"mosaic '{folder}' --config" in command
    photographs_loaded(owner).get_by_role("button").first.click()
    expect(photographs_loaded(owner)).to_have_count(PHOTOGRAPHS - 1)
    owner.get_by_role("button", name="Remove all").click()
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == before


def test_a_folder_outside_is_refused_and_the_reason_stays(owner: Page) -> None:
    for path in ("/etc", "../..", "no such folder"):
        open_folder(owner, path)
        expect(owner.get_by_role("alert").filter(has_text=f"{path}: ")).to_be_visible()
    expect(photographs_loaded(owner)).to_have_count(0)


def test_without_the_token_no_folder_can_be_opened(panel: str) -> None:
    for address in (panel, f"{panel}/?token=", f"{panel}/?token=x"):
        page = httpx.get(address).text
        assert "the address that the panel printed" in page
        assert "Open a folder" not in page


@pytest.mark.slow
def test_a_folder_that_vanishes_is_one_line_and_loses_nothing(owner: Page, root: Path, folder: Path) -> None:
    """Ten thousand photographs: the page answers meanwhile, and shows the earlier result afterwards."""
    owner.get_by_role("button", name="Try the built-in pair").click()
    expect(corner_counts(owner)).to_contain_text("corners")
    make_mosaic(owner)
    large = root / "large"
    large.mkdir()
    (large / "0.png").write_bytes(noise_png(96, 1))
    for number in range(1, MANY):
        (large / f"{number}.png").hardlink_to(large / "0.png")
    open_folder(owner, str(large))
    expect(owner.get_by_text(f"{MANY} photographs, the first 500 are shown")).to_be_visible()
    shutil.rmtree(large)
    started = time.monotonic()
    owner.get_by_role("tab", name="Numbers").click()
    expect(owner.get_by_role("tabpanel", name="Numbers")).to_contain_text("mutual matches")
    assert time.monotonic() - started < 5
    warning = owner.get_by_role("status", name="Warnings")
    expect(warning).to_contain_text(f"of {MANY} photographs could not be read; the first: ")
    assert "\n" not in (warning.text_content() or "")
    owner.get_by_role("button", name="Make the mosaic").click()
    expect(owner.get_by_role("alert").filter(has_text=f"none of the {MANY} photographs can be used")).to_be_visible()
    owner.get_by_role("tab", name="Mosaic").click()
    expect(owner.get_by_role("group", name="Mosaic")).to_be_visible()
