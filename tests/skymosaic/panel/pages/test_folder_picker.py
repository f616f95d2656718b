"""A folder of the panel's machine, as its owner opens it."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from nicegui import Client
from nicegui.page import page as nicegui_page
from playwright.sync_api import Page, expect

from skymosaic.panel.folders import Roots
from skymosaic.panel.pages.folder_picker import FolderPicker
from tests.skymosaic.panel.visitor import Scenario, open_tab
from tools.panel import corner_counts, make_mosaic

DECODED_WIDTHS = """
    () => Promise.all([...document.querySelectorAll("img, svg image")].map(async each => {
        const answer = await fetch(each.getAttribute("src") || each.getAttribute("href"));
        return (await createImageBitmap(await answer.blob())).width;
    }))"""
"""The widths of all pictures of a page; an error where one cannot be decoded."""


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


def test_photographs_and_folders_of_any_name_are_shown(
    opened: Page, owner_address: str, root: Path, photographs: list[Path]
) -> None:
    """Names that no text in UTF-8 has, of characters that an address or a page must not have, and as long as can be."""
    (folder := root / os.fsdecode(b"S\xfcd <b>\n")).mkdir()
    names = [os.fsdecode(b"a #1?%20&x\\\n\xff.png"), "b" * 251 + ".png"]
    for path, name in zip(photographs, names, strict=True):
        shutil.copy(path, folder / name)
    opened.goto(owner_address)
    opened.get_by_role("button", name="Open a folder").click()
    opened.get_by_role("button", name=r"S\udcfcd <b>\n").click()
    expect(opened.get_by_role("textbox", name="Folder")).to_have_value(f"{root}/" r"S\udcfcd <b>\n")
    opened.get_by_role("button", name="Open", exact=True).click()
    expect(opened.get_by_role("button", name=r"Remove a #1?%20&x\\n\udcff.png")).to_be_visible()
    expect(corner_counts(opened)).to_contain_text(" and ")
    make_mosaic(opened)
    # Beside the thumbnails.
    for tab, pictures in (("Corners", 2), ("Matches", 2), ("Mosaic", 1)):
        open_tab(opened, tab)
        expect(opened.locator("svg image")).to_have_count(pictures)
        assert len(opened.evaluate(DECODED_WIDTHS)) == 2 + pictures
