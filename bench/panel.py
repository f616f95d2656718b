"""How fast the panel answers: corners after the threshold slider, and frames while its viewers are moved and zoomed.

    python bench/panel.py

Runs the panel and headless Chromium, which draws on the processor: a machine with a graphics card is faster. The slider
goes through half of its range by key presses on the built-in pair; a step ends with the first frame that shows other
corners. Each viewer is zoomed into, dragged around and zoomed out of; a frame's time is from one call of
``requestAnimationFrame`` to the next (16.7 ms at 60 frames a second), and a long task blocks the page for
more than 50 ms. The mosaic by tiles is that of photographs of 3200x2400.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Browser, Locator, Page, expect

from sim.scene import make_pair
from tools.panel.visit import (
    chromium,
    load_built_in_pair,
    make_mosaic,
    mosaic_viewer,
    open_page,
    open_tab,
    photographs_loaded,
    running_panel,
    threshold_to_corners_ms,
)

LONGEST_WAIT_MS = 120_000
SLIDER_KEYS = ("ArrowLeft",) * 7 + ("ArrowRight",) * 14 + ("ArrowLeft",) * 7
"""From the middle of the range down, up beyond the middle, and back, so that a mosaic can be made afterwards."""
ENLARGED = 5
ZOOM_STEPS = 6
DRAG_STEPS = 120
DRAG_RADIUS_PX = 120
START_RECORDING = """() => {
    const record = { frames: [], longTasks: [] };
    const observer = new PerformanceObserver(list => record.longTasks.push(...list.getEntries().map(e => e.duration)));
    observer.observe({ type: "longtask" });
    let before, next;
    const frame = now => {
        if (before !== undefined) record.frames.push(now - before);
        before = now;
        next = requestAnimationFrame(frame);
    };
    next = requestAnimationFrame(frame);
    window.stopRecording = () => { cancelAnimationFrame(next); observer.disconnect(); return record; };
}"""


def move_and_zoom(page: Page, viewer: Locator) -> None:
    """Zoom into a viewer by the wheel, drag the picture in circles, and zoom out again."""
    box = viewer.locator("> svg").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    for _ in range(ZOOM_STEPS):
        page.mouse.wheel(0, -100)
        page.wait_for_timeout(50)
    page.mouse.down()
    for step in range(DRAG_STEPS):
        angle = 4 * math.pi * step / DRAG_STEPS
        page.mouse.move(x + DRAG_RADIUS_PX * math.sin(angle), y + DRAG_RADIUS_PX * (1 - math.cos(angle)) / 2)
    page.mouse.up()
    for _ in range(ZOOM_STEPS):
        page.mouse.wheel(0, 100)
        page.wait_for_timeout(50)


def frames_row(page: Page, viewer: Locator, title: str) -> str:
    """A row of the table: how long frames took while a viewer moved."""
    viewer.scroll_into_view_if_needed()
    page.evaluate(START_RECORDING)
    move_and_zoom(page, viewer)
    record = page.evaluate("window.stopRecording()")
    median, most, longest = np.percentile(record["frames"], (50, 95, 100))
    tasks = f"{len(record['longTasks'])}, longest {max(record['longTasks'])} ms" if record["longTasks"] else "none"
    return f"| {title} | {median:.0f} ms | {most:.0f} ms | {longest:.0f} ms | {tasks} |"


def open_panel(browser: Browser, address: str) -> Page:
    """The panel's page, in which no wait is endless."""
    page = open_page(browser, address)
    page.set_default_timeout(LONGEST_WAIT_MS)
    expect.set_options(timeout=LONGEST_WAIT_MS)
    return page


def measure_pair(browser: Browser, address: str) -> None:
    """Slider, mosaic and matches of the built-in pair."""
    page = open_panel(browser, address)
    load_built_in_pair(page)
    steps = threshold_to_corners_ms(page, SLIDER_KEYS)
    print(f"slider, {len(steps)} steps: median {np.median(steps):.0f} ms, longest {max(steps):.0f} ms\n")
    make_mosaic(page)
    print("| | median | 95 % | longest | long tasks |\n|---|---|---|---|---|")
    print(frames_row(page, mosaic_viewer(page), "mosaic"))
    open_tab(page, "Matches")
    matches = page.get_by_role("group", name="Matches between the photographs")
    print(frames_row(page, matches, "matches, 100 lines"))
    for kind in ("kept, off it", "rejected by the rules"):
        page.get_by_role("checkbox", name=kind).click()
    slider = page.get_by_role("slider", name="Most lines drawn")
    slider.press("End")
    expect(slider).not_to_have_attribute("aria-valuetext", "100 lines")
    print(frames_row(page, matches, f"matches, all {slider.get_attribute('aria-valuetext')}"))
    page.context.close()


def measure_tiles(browser: Browser, address: str, folder: Path) -> None:
    """A mosaic large enough to be shown by tiles."""
    paths = [folder / "left.png", folder / "right.png"]
    for path, image in zip(paths, make_pair(seed=5).images, strict=True):
        cv2.imwrite(str(path), cv2.resize(image, None, fx=ENLARGED, fy=ENLARGED))
    page = open_panel(browser, address)
    page.get_by_label("Choose photographs").set_input_files(paths)
    expect(photographs_loaded(page)).to_have_count(2)
    make_mosaic(page)
    print(frames_row(page, mosaic_viewer(page), "mosaic by tiles"))
    page.context.close()


def main() -> None:
    """Measure with one panel and one browser."""
    with tempfile.TemporaryDirectory() as temporary, chromium() as browser:
        folder = Path(temporary)
        with running_panel(folder) as address:
            measure_pair(browser, address)
            measure_tiles(browser, address, folder)


if __name__ == "__main__":
    main()
