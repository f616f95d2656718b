"""What a test does as a visitor: uploads a picture, waits for the end of a job, repeats what the archive says."""

import asyncio
import re
import subprocess
import sys
import zipfile
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Page

from skymosaic.panel.session import Session

Scenario = Callable[[], Awaitable[None]]


def noise_png(side_px: int, seed: int) -> bytes:
    noise = np.random.default_rng(seed).integers(0, 256, (side_px, side_px), np.uint8)
    return cv2.imencode(".png", noise)[1].tobytes()


async def body(data: bytes) -> AsyncIterator[bytes]:
    yield data


async def idle(session: Session) -> None:
    while session.job is not None:
        await asyncio.sleep(0.02)


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
    program, *arguments = (run / "command.txt").read_text().split()
    assert program == "skymosaic"
    subprocess.run([sys.executable, "-m", "skymosaic", *arguments], cwd=run, check=True, capture_output=True)
    return run
