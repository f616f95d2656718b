"""Names of files and EXIF text that contain code, in every page that shows them, opened in a real browser."""

from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage
from playwright.sync_api import Browser, Page, expect

from tests.system.command_line import skymosaic

CODE = "<img src=x onerror=attacked=1>"
NAMES = (f"0{CODE}.jpg", "1\"'><svg onload=attacked=1>.jpg", "2<script>attacked=1<script>.jpg")
ATTACKED = "() => typeof attacked !== 'undefined'"


@pytest.fixture
def photographs(tmp_path: Path, folder: Path) -> Path:
    """Three photographs of a flight with such names, and the same in their EXIF text."""
    exif = PillowImage.Exif()
    for tag in (0x010E, 0x010F, 0x0110, 0x0131, 0x013B):
        exif[tag] = f"{CODE}<script>attacked=1</script>"
    (tmp_path / "p").mkdir()
    for number, name in enumerate(NAMES):
        pixels = np.asarray(cv2.imread(str(folder / f"{number}.png")))[..., ::-1]
        PillowImage.fromarray(pixels).save(tmp_path / "p" / name, "JPEG", exif=exif, quality=95)
    return tmp_path / "p"


def open_quietly(browser: Browser, address: str) -> Page:
    page = browser.new_page()
    page.on("dialog", lambda dialog: pytest.fail(dialog.message))
    page.goto(address, wait_until="load")
    return page


def test_reports_and_tiles_run_no_code_of_a_file(tmp_path: Path, photographs: Path, browser: Browser) -> None:
    output = tmp_path / f"{CODE}.png"
    made = skymosaic("mosaic", photographs, "-o", output, "--report", "report", "--tiles", "tiles", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    for folder in ("report", "tiles"):
        page = open_quietly(browser, (tmp_path / folder / "index.html").as_uri())
        assert CODE in page.locator("body").inner_text() + page.title()
        assert not page.evaluate(ATTACKED)
        page.close()
    for path in (tmp_path / "report").glob("*.kml"):
        ElementTree.parse(path)


def test_the_panel_runs_no_code_of_a_file(owner_address: str, photographs: Path, browser: Browser) -> None:
    page = open_quietly(browser, owner_address)
    broken = photographs / f"broken{CODE}.jpg"
    broken.write_bytes(b"\xff\xd8\xff" + CODE.encode() * 9)
    page.get_by_label("Choose photographs").set_input_files([*(photographs / name for name in NAMES), broken])
    expect(page.get_by_text("0_img_src_x_onerror_attacked_1").first).to_be_visible()
    # The line of a file that is refused names it, too.
    expect(page.get_by_text("broken_img_src").first).to_be_visible()
    assert not page.evaluate(ATTACKED)
    page.close()
