"""Fixtures: a session in this process, a panel in a process of its own, and Chromium if the machine has it."""

import asyncio
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import nicegui.core
import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, expect

from sim.scene import make_pair
from skymosaic.panel.folders import Roots
from skymosaic.panel.runs import open_runs
from skymosaic.panel.session import Session
from skymosaic.panel.tasks.jobs import prepare_workers
from tests.skymosaic.panel.visitor import Scenario
from tools.panel import chromium, corner_counts, make_mosaic, open_page, running_panel


@pytest.fixture(scope="session")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The only folder whose photographs the running panel opens."""
    return tmp_path_factory.mktemp("root")


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the running panel's finished runs."""
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="session")
def silent_board() -> Iterator[str]:
    """The address of a board that never answers, so that what it computes takes long."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"127.0.0.1:{server.getsockname()[1]}"


@pytest.fixture(scope="module")
def owner_address(tmp_path_factory: pytest.TempPathFactory, root: Path, kept: Path, silent_board: str) -> Iterator[str]:
    """The address, as it prints it, of a panel that runs for one module, whose tests share its one session."""
    folders = "--root", str(root), "--runs", str(kept)
    with running_panel(tmp_path_factory.mktemp("panel"), *folders, "--board", silent_board) as address:
        yield address


@pytest.fixture(scope="module")
def panel(owner_address: str) -> str:
    """The address of that panel, without the token and without a slash at the end."""
    return owner_address.partition("/?")[0]


@pytest.fixture(scope="session")
def workers() -> None:
    """Starts the helper process that workers are forked from, as a panel does."""
    prepare_workers()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium for one module: Playwright's event loop runs as long as it does, and no test can start another loop."""
    with chromium() as started:
        yield started


def is_complaint(message: ConsoleMessage) -> bool:
    """Whether a message reports a fault of the page; a refused upload is not one."""
    return message.type == "error" and "Failed to load resource" not in message.text


@pytest.fixture(scope="module")
def opened(browser: Browser) -> Iterator[Page]:
    """A page that a module opens once: a new one would fetch and compile all of NiceGUI again."""
    page = open_page(browser, "about:blank")
    yield page
    page.context.close()


@pytest.fixture
def page(browser: Browser, tmp_path: Path, silent_board: str) -> Iterator[Page]:
    """The page of a new panel; an error that the browser reports, or another server, fails the test."""
    opened = open_page(browser, "about:blank")
    complaints: list[str] = []
    own: tuple[str, ...] = ()
    hear: dict[Any, Any] = {
        "pageerror": lambda error: complaints.append(str(error)),
        "console": lambda message: complaints.append(message.text) if is_complaint(message) else None,
        "request": lambda sent: None if sent.url.startswith(own) else complaints.append(sent.url),
    }
    for event, handler in hear.items():
        opened.on(event, handler)
    (tmp_path / "panel").mkdir()
    with running_panel(tmp_path / "panel", "--board", silent_board) as address:
        own = address.partition("?")[0], "data:", "blob:"
        opened.goto(address)
        yield opened
        opened.context.close()
    assert complaints == []


@pytest.fixture(scope="module")
def made(opened: Page, owner_address: str, photographs: list[Path]) -> Page:
    """The opened page of the module's panel, which has made the mosaic of two photographs."""
    opened.goto(owner_address)
    opened.get_by_label("Choose photographs").set_input_files(photographs)
    expect(corner_counts(opened)).to_contain_text("corners")
    make_mosaic(opened)
    return opened


@pytest.fixture(scope="session")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two overlapping photographs."""
    folder = tmp_path_factory.mktemp("photographs")
    paths = [folder / "left.png", folder / "right.png"]
    for path, image in zip(paths, make_pair(seed=9, size=(400, 300)).images, strict=True):
        cv2.imwrite(str(path), image)
    return paths


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    """A session in this process; its finished runs are kept below the test's folder."""
    with open_runs(tmp_path / "runs") as runs:
        created = Session(runs, Roots([tmp_path]))
        yield created
        created.close()


@pytest.fixture
def run_in_loop(monkeypatch: pytest.MonkeyPatch) -> Callable[[Scenario], None]:
    """Runs a coroutine in the event loop that NiceGUI gives its background tasks to."""

    def run(scenario: Scenario) -> None:
        async def in_loop() -> None:
            monkeypatch.setattr(nicegui.core, "loop", asyncio.get_running_loop())
            await scenario()

        asyncio.run(in_loop())

    return run
