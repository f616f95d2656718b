"""What a test does as a visitor: uploads a picture, chooses an option, repeats what the archive says."""

import asyncio
import re
import shlex
import subprocess
import sys
import zipfile
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import httpx
import numpy as np
from playwright.sync_api import CDPSession, Locator, Page, expect

from skymosaic.panel.session import Session
from tools.panel import open_advanced

MAX_CONTROLS = 100
Scenario = Callable[[], Awaitable[None]]


def noise_png(seed: int = 1, side_px: int = 96) -> bytes:
    noise = np.random.default_rng(seed).integers(0, 256, (side_px, side_px), np.uint8)
    return cv2.imencode(".png", noise)[1].tobytes()


@contextmanager
def enter(owner_address: str) -> Iterator[httpx.Client]:
    """A browser without a screen: it was given the address with the token, and sends the page's own Origin."""
    panel = owner_address.partition("/?")[0]
    with httpx.Client(base_url=panel, headers={"origin": panel}, timeout=None) as client:
        entered = client.get(owner_address)
        assert (entered.status_code, entered.headers["location"]) == (303, "/")
        assert "httponly" in entered.headers["set-cookie"].lower()
        yield client


def upload(
    client: httpx.Client, name: str, content: bytes | Iterator[bytes], slot: str = "photograph"
) -> httpx.Response:
    return client.post(f"/upload/{slot}", params={"name": name}, content=content)


async def body(data: bytes) -> AsyncIterator[bytes]:
    yield data


async def idle(session: Session) -> None:
    while session.job is not None:
        await asyncio.sleep(0.02)


def photographs_loaded(page: Page) -> Locator:
    return page.get_by_role("list", name="Photographs loaded").locator("li")


def open_tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name).click()
    expect(page.get_by_role("tabpanel", name=name)).to_be_visible()


def choose(page: Page, option: str, value: str) -> None:
    open_advanced(page)
    page.get_by_role("combobox", name=option).click()
    page.get_by_role("option", name=value, exact=True).click()


def middle_of(line: Locator) -> tuple[float, float]:
    """The middle of a line of an SVG path, in window pixels."""
    x, y = line.evaluate(
        """path => {
            const [x0, y0, x1, y1] = path.getAttribute("d").match(/-?[\\d.]+/g).slice(0, 4).map(Number);
            const middle = new DOMPoint((x0 + x1) / 2, (y0 + y1) / 2).matrixTransform(path.getScreenCTM());
            return [middle.x, middle.y];
        }"""
    )
    return x, y


def repeat_archive(page: Page, folder: Path, name: str) -> Path:
    """Repeat a run's command on the archive's inputs; returns its folder. The first results are in ``before``."""
    with page.expect_download() as download:
        page.get_by_role("link", name="Download everything").click()
    download.value.save_as(folder / "all.zip")
    with zipfile.ZipFile(folder / "all.zip") as archive:
        archive.extractall(folder)
    run = folder / name
    texts = [path for path in run.rglob("*") if path.suffix in (".csv", ".html", ".json", ".toml", ".txt")]
    assert not any("skymosaic-panel-" in path.read_text() for path in texts), "the server's folder is named"
    run.rename(folder / "before")
    run.mkdir()
    for path in (folder / "before").iterdir():
        if re.match(r"\d\d_|config|command", path.name):
            path.rename(run / path.name)
    program, *arguments = shlex.split((run / "command.txt").read_text())
    assert program == "skymosaic"
    subprocess.run([sys.executable, "-m", "skymosaic", *arguments], cwd=run, check=True, capture_output=True)
    return run


def names_reached_by_tab(page: Page) -> list[str]:
    """The accessible names of everything Tab reaches in one round; checks that all have one and none is left out."""
    session = page.context.new_cdp_session(page)
    page.evaluate("document.activeElement.blur()")
    reached: list[tuple[int, str, str]] = []
    for _ in range(MAX_CONTROLS):
        page.keyboard.press("Tab")
        control = _focused_control(session)
        if len(reached) > 1 and control == reached[0]:
            break
        # Between the last and the first, the focus is on the browser's own controls; some it keeps in the page's.
        if control is not None and control not in reached[-1:]:
            reached.append(control)
    assert [role for _, role, name in reached if not name] == []
    shown = page.evaluate(
        """() => [...document.querySelectorAll("button, a[href], input, [role=switch], [role=checkbox], svg[tabindex]")]
            .filter(element => element.checkVisibility() && !element.disabled).length"""
    )
    assert shown <= len(reached) < MAX_CONTROLS
    return [name for *_, name in reached]


def _focused_control(session: CDPSession) -> tuple[int, str, str] | None:
    """Number, role and accessible name of the element with the focus, if the page has it."""
    element = session.send("Runtime.evaluate", {"expression": "document.activeElement"})["result"]
    found = session.send("Accessibility.getPartialAXTree", {"objectId": element["objectId"], "fetchRelatives": False})
    (node,) = found["nodes"]
    if node["ignored"] or element["className"] == "HTMLBodyElement":
        return None
    return node["backendDOMNodeId"], node["role"]["value"], node["name"]["value"].strip()
