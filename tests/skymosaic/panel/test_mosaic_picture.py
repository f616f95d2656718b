"""The pictures of a mosaic for the page: every tile is a part of the mosaic, and the finest are its own pixels."""

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from skymosaic.compositing.layer import SeamMask
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.picture.composition import Composition, Placement
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.panel.tasks import mosaic_picture
from skymosaic.panel.tasks.mosaic_picture import show_mosaic
from tools.panel.visit import make_mosaic, mosaic_viewer, photographs_loaded

MOSAIC = cv2.GaussianBlur(np.random.default_rng(2).integers(0, 256, (700, 1200, 3), np.uint8), (0, 0), 4)


def delivery(image: np.ndarray) -> SimpleNamespace:
    """A mosaic whose canvas begins at (-100, 50); one photograph shows in a rectangle of it."""
    mask = np.zeros((40, 60), np.uint8)
    mask[10:20, 30:50] = 255
    seam = SeamMask(mask, Canvas(-10, 5, 60, 40), 0.1)
    source = Source(0, "a.jpg", Path("a.jpg"))
    placements = (Placement(source, (200, 100), np.eye(3), seam=seam), Placement(source, (200, 100), np.eye(3)))
    canvas = Canvas(-100, 50, image.shape[1], image.shape[0])
    composition = Composition(placements, canvas, coloured=True, blending="multiband", lens=Lens())
    return SimpleNamespace(preview=image, composition=composition)


def test_tiles_are_parts_of_the_mosaic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mosaic_picture, "PICTURE_SIDE_PX", 300)
    shown = show_mosaic(delivery(MOSAIC), tmp_path, "mosaic-1")
    assert shown.shown_size == (300, 175)
    assert sorted({tile.scale for tile in shown.tiles}) == [0.25, 0.5]
    for scale in (0.25, 0.5):
        whole = cv2.resize(MOSAIC, None, fx=0.25 / scale, fy=0.25 / scale, interpolation=cv2.INTER_AREA)
        covered = np.zeros(whole.shape[:2], bool)
        for tile in (tile for tile in shown.tiles if tile.scale == scale):
            pixels = cv2.imread(str(tile.picture))
            x, y = round(tile.x / scale), round(tile.y / scale)
            part = slice(y, y + len(pixels)), slice(x, x + pixels.shape[1])
            assert (tile.width / scale, tile.height / scale) == (pixels.shape[1], len(pixels))
            assert np.abs(whole[part].astype(int) - pixels).mean() < 3
            covered[part] = True
        assert covered.all()


def test_a_small_mosaic_has_no_tiles(tmp_path: Path) -> None:
    shown = show_mosaic(delivery(MOSAIC), tmp_path, "mosaic-1")
    assert shown.tiles == ()
    assert [path.name for path in tmp_path.iterdir()] == ["mosaic-1.jpg"]


def test_seams_lie_where_their_photograph_shows(tmp_path: Path) -> None:
    (line,) = show_mosaic(delivery(MOSAIC), tmp_path, "mosaic-1").seams
    # Mask pixels 30..49, 10..19 of a frame at (-10, 5) whose pixels are 10 of the mosaic's, on a canvas at (-100, 50).
    assert np.allclose(line.min(axis=0), (304.5, 104.5))
    assert np.allclose(line.max(axis=0), (494.5, 194.5))


@pytest.mark.slow
def test_the_page_loads_the_tiles_that_are_zoomed_into(page: Page, photographs: list[Path], tmp_path: Path) -> None:
    larger = [tmp_path / path.name for path in photographs]
    for path, target in zip(photographs, larger, strict=True):
        cv2.imwrite(str(target), cv2.resize(cv2.imread(str(path)), None, fx=5, fy=5))
    page.get_by_label("Choose photographs").set_input_files(larger)
    expect(photographs_loaded(page)).to_have_count(2)
    loaded: list[str] = []
    page.on("response", lambda response: loaded.append(response.url) if response.ok else None)
    make_mosaic(page)
    drawing = mosaic_viewer(page).locator("> svg")
    expect(drawing.locator("image")).to_have_count(1)
    drawing.focus()
    for _ in range(8):
        page.keyboard.press("+")
    expect(drawing.locator("image")).not_to_have_count(1)
    left, top, width, height = map(float, drawing.get_attribute("viewBox").split())
    tiles = drawing.locator("image").evaluate_all("all => all.slice(1).map(t => [t.x, t.y].map(p => p.baseVal.value))")
    assert all(x < left + width and y < top + height for x, y in tiles)
    page.wait_for_load_state("networkidle")
    names = drawing.locator("image").evaluate_all("all => all.slice(1).map(t => t.getAttribute('href'))")
    assert {page.url.rstrip("/") + name for name in names} <= set(loaded)
