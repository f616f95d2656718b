"""A panel in a process of its own, and Chromium where the machine has it."""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, sync_playwright

from sim.scene import pair as rendered_pair

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
CHROMIUM_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-background-networking",
    "--disable-component-update", "--no-first-run",
)  # fmt: skip
WINDOW = {"width": 1280, "height": 720}


@pytest.fixture(scope="session")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a running panel, without a slash at the end."""
    log = tmp_path_factory.mktemp("panel") / "log"
    with log.open("w") as output:
        command = [sys.executable, "-u", "-m", "skymosaic", "panel", "--port", "0"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=output, text=True, cwd=log.parent)
        with server:
            line = server.stdout.readline()
            address = re.search(r"http://127\.0\.0\.1:\d+", line)
            assert address, line + log.read_text()
            yield address.group()
            server.terminate()
            server.wait(timeout=20)
    assert "Traceback" not in log.read_text(), log.read_text()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium for one module: while Playwright runs, so does its event loop, and no test can start another."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine; on Debian: apt-get install chromium")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=list(CHROMIUM_FLAGS))
        yield chromium
        chromium.close()


def is_complaint(message: ConsoleMessage) -> bool:
    """Whether the browser reports a fault of the page; an upload that was refused is none."""
    return message.type == "error" and "Failed to load resource" not in message.text


@pytest.fixture
def page(browser: Browser, panel: str) -> Iterator[Page]:
    """The panel as a new visitor sees it; what the browser complains about fails the test."""
    context = browser.new_context(viewport=WINDOW)
    opened = context.new_page()
    complaints: list[str] = []
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on("console", lambda message: complaints.append(message.text) if is_complaint(message) else None)
    opened.goto(panel)
    yield opened
    context.close()
    assert complaints == []


@pytest.fixture(scope="session")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two overlapping photographs."""
    folder = tmp_path_factory.mktemp("photographs")
    paths = [folder / "left.png", folder / "right.png"]
    for path, image in zip(paths, rendered_pair(seed=5).images, strict=True):
        cv2.imwrite(str(path), image)
    return paths
