"""The page that `mosaic --tiles` writes, opened from a folder in a real browser."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from skymosaic.maps.georeference import Georeference
from skymosaic.maps.geotiff import tee_to_raster
from skymosaic.maps.tiles import write_tiles
from tests.system.looking import barriers

WIDTH, HEIGHT = 900, 700
PLACE = Georeference("EPSG:32615", np.array([[0.1, 0, 430_000], [0, -0.1, 5_190_000], [0, 0, 1]]), 0.5)
LOADED = "() => [...document.querySelectorAll('#map img')].filter(i => i.complete && i.naturalWidth === 256)"


def red_area_px(page: Page) -> int:
    """What shows the spot in the window."""
    window = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR).astype(int)
    return int(np.count_nonzero(window[..., 2] - window[..., 0] > 100))


@pytest.mark.slow
@pytest.mark.parametrize("place", [PLACE, None], ids=["map", "pixels"])
def test_the_tile_page_shows_the_mosaic_and_zooms_without_a_network(
    tmp_path: Path, browser: Browser, place: Any
) -> None:
    picture = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    cv2.circle(picture, (450, 350), 60, (0, 0, 255), -1)
    shown = np.ones((HEIGHT, WIDTH), np.uint16)
    for _ in tee_to_raster(tmp_path / "m.tif", (WIDTH, HEIGHT), [(picture, shown)], place):
        pass
    write_tiles(tmp_path / "tiles", tmp_path / "m.tif", "field", None)
    page = browser.new_page(viewport={"width": 800, "height": 600})
    asked, complaints = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto((tmp_path / "tiles" / "index.html").as_uri())
    page.wait_for_function(f"({LOADED})().length > 0")
    assert page.locator("#title").inner_text() == "field"
    assert page.locator("#length").inner_text().endswith(" px" if place is None else " m")
    before = red_area_px(page)
    assert before > 1000
    page.get_by_role("button", name="Zoom in").click()
    page.wait_for_function("() => [...document.querySelectorAll('#map img')].every(image => image.complete)")
    assert red_area_px(page) == pytest.approx(4 * before, rel=0.1)
    page.mouse.move(400, 300)
    assert page.locator("#place").inner_text().count(", ") == 1
    assert complaints == []
    assert all(url.startswith("file:") for url in asked)
    page.close()


@pytest.mark.slow
def test_controls_stay_above_deep_tiles_and_measure_the_ground(tmp_path: Path, browser: Browser) -> None:
    picture = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8), (0, 0), 3)
    for _ in tee_to_raster(tmp_path / "m.tif", (WIDTH, HEIGHT), [(picture, np.ones((HEIGHT, WIDTH), np.bool_))], PLACE):
        pass
    write_tiles(tmp_path / "tiles", tmp_path / "m.tif", "a field with a long name", None)
    page = browser.new_page(viewport={"width": 390, "height": 700})
    page.goto((tmp_path / "tiles" / "index.html").as_uri())
    page.wait_for_function(f"({LOADED})().length > 0")
    for _ in range(4):
        page.get_by_role("button", name="Zoom in").click()
    page.get_by_role("button", name="Measure lengths and areas").click()
    pixels = float(page.locator("#bar").evaluate("bar => parseFloat(bar.style.width)"))
    metres = float(page.locator("#length").inner_text().split()[0])
    for x, y in ((100, 300), (200, 300), (200, 400)):
        page.mouse.click(x, y)
    length, area = page.locator("#measured").inner_text().split(", ")
    assert float(length.removesuffix(" m")) == pytest.approx(200 * metres / pixels, rel=0.02)
    assert float(area.removesuffix(" m\u00b2")) == pytest.approx(5000 * (metres / pixels) ** 2, rel=0.02)
    page.locator("#opacity").fill("50")
    assert page.locator("#map").evaluate("map => getComputedStyle(map).opacity") == "0.5"
    covered = """() => [...document.querySelectorAll("button, input, .box:not([hidden])")].filter(each => {
        const { x, y, width, height } = each.getBoundingClientRect();
        return !each.contains(document.elementFromPoint(x + width / 2, y + height / 2));
    }).map(each => each.outerHTML)"""
    assert page.evaluate(covered) == []
    assert barriers(page) == []
    page.close()
