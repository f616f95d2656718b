"""A panel in a process of its own, the machine's Chromium, and the steps of a user in both.

``python -m tools.panel`` makes the mosaic of the built-in pair.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Locator, Page, ViewportSize, expect, sync_playwright

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
CHROMIUM_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-background-networking",
    "--disable-component-update", "--no-first-run",
)  # fmt: skip
WINDOW: ViewportSize = {"width": 1280, "height": 720}
PHONE: ViewportSize = {"width": 390, "height": 844}
AT_ONCE = """
    addEventListener("DOMContentLoaded", () => {
        const style = document.createElement("style");
        style.textContent = "*, ::before, ::after { transition: none !important; animation: none !important; }";
        document.head.append(style);
    });
"""
"""Makes a page change without moving: whoever looks next sees its final state, and need not wait for it."""
LONG_MS = 600_000
"""Limit of every wait: only a panel that hangs exceeds it, even on a busy machine."""


@contextmanager
def running_panel(folder: Path, *options: str) -> Iterator[str]:
    """The address of a panel that runs in ``folder``, with its token; a stack of calls in its log fails the test."""
    log = folder / "log"
    with log.open("w") as output:
        command = [sys.executable, "-u", "-m", "skymosaic", "panel", "--port", "0", "--runs", "runs", *options]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=output, text=True, cwd=folder)
        with server:
            try:
                line = server.stdout.readline() if server.stdout else ""
                address = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", line)
                assert address, line + log.read_text()
                yield address.group()
                assert server.poll() is None, log.read_text()
            finally:
                server.terminate()
                server.wait(timeout=LONG_MS / 1000)
    # NiceGUI logs a stack, too, where a page updates what it has deleted.
    assert "most recent call last" not in log.read_text(), log.read_text()


@contextmanager
def chromium() -> Iterator[Browser]:
    """The machine's Chromium, without a window."""
    expect.set_options(timeout=LONG_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(CHROMIUM_FLAGS))
        yield browser
        browser.close()


def open_page(browser: Browser, address: str, **options: Any) -> Page:
    """A page in a browser profile of its own."""
    context = browser.new_context(**{"viewport": WINDOW} | options)
    context.set_default_timeout(LONG_MS)
    context.add_init_script(AT_ONCE)
    page = context.new_page()
    page.goto(address)
    return page


def corner_counts(page: Page) -> Locator:
    return page.get_by_role("status", name="Corners found")


def mosaic_viewer(page: Page) -> Locator:
    return page.get_by_role("group", name="Mosaic")


def load_built_in_pair(page: Page) -> None:
    page.get_by_role("button", name="Try the built-in pair").click()
    expect(corner_counts(page)).to_contain_text("corners")


def make_mosaic(page: Page) -> None:
    page.get_by_role("button", name="Make the mosaic").click()
    expect(mosaic_viewer(page)).to_be_visible()


def open_advanced(page: Page) -> None:
    """Show every option."""
    advanced = page.get_by_role("button", name="Advanced")
    if advanced.get_attribute("aria-expanded") != "true":
        advanced.click()
    expect(page.get_by_role("combobox", name="Detector")).to_be_visible()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as log_folder, running_panel(Path(log_folder)) as panel, chromium() as browser:
        opened = open_page(browser, panel)
        load_built_in_pair(opened)
        make_mosaic(opened)
