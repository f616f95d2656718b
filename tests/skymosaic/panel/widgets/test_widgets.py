"""Widgets in a page, and a slider without one."""

from collections.abc import Callable
from pathlib import Path

import cv2
import pytest
from nicegui import Client
from nicegui.page import page
from playwright.sync_api import Page, expect

from skymosaic.panel.widgets import Slider
from tests.skymosaic.panel.visitor import Scenario, photographs_loaded
from tools.panel import make_mosaic, mosaic_viewer


def test_the_thumb_is_moved_only_where_it_is_not_yet(
    run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    moved: list[object] = []
    monkeypatch.setattr(Slider, "run_method", lambda _slider, *call: moved.append(call))

    async def scenario() -> None:
        with Client(page("/slider"), request=None):
            slider = Slider(lambda _position: None)
        for position in (3, 3, 5, 4, 4):
            slider.show(lowest=0, highest=9, position=position, label="Threshold", words=f"{position} px")
        assert moved == [("moveTo", 5), ("moveTo", 4)]
        assert slider.props == {"start": 3, "min": 0, "max": 9, "label": "Threshold", "words": "4 px"}

    run_in_loop(scenario)


@pytest.mark.slow
def test_the_page_loads_the_tiles_that_are_zoomed_into(page: Page, photographs: list[Path], tmp_path: Path) -> None:
    larger = [tmp_path / path.name for path in photographs]
    for path, target in zip(photographs, larger, strict=True):
        cv2.imwrite(str(target), cv2.resize(cv2.imread(str(path)), None, fx=8, fy=8))
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
