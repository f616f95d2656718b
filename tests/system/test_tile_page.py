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
    shown = np.ones((HEIGHT, WIDTH), np.bool_)
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
