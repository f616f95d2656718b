"""Commands that are killed again and again: each output is whole or absent, and the last run leaves nothing else."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.scene import make_lawnmower

KILLS = 30
pytestmark = pytest.mark.slow


@pytest.fixture
def folders(tmp_path: Path) -> Path:
    """Photographs, and places for outputs and temporary files."""
    for name in ("photographs", "out", "temp", "fresh"):
        (tmp_path / name).mkdir()
    for number, image in enumerate(make_lawnmower(3, 9, (400, 300)).images):
        cv2.imwrite(str(tmp_path / "photographs" / f"IMG_{number}.png"), image)
    return tmp_path


def start(folders: Path, *words: object) -> subprocess.Popen[str]:
    environment = {**os.environ, "TMPDIR": str(folders / "temp"), "PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-m", "skymosaic", *map(str, words), "--overwrite"]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)


def finish(process: subprocess.Popen[str]) -> float:
    """Wait for a run that must end by itself; returns the seconds that it took."""
    started = time.monotonic()
    errors = process.communicate()[1]
    assert process.returncode == 0, errors
    assert "error" not in errors
    return time.monotonic() - started


def kill_again_and_again(run: Callable[[], subprocess.Popen[str]], check: Callable[[], None], seconds: float) -> None:
    """Kill runs at random moments and check what is there; the last one must end by itself.

    A whole run takes about so many ``seconds``; later ones find what earlier ones left in the cache.
    """
    killed = 0
    for share in np.random.default_rng(16).uniform(0.02, 1, KILLS):
        process = run()
        started = time.monotonic()
        try:
            process.communicate(timeout=share * seconds)
            seconds = time.monotonic() - started
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            killed += process.returncode == -signal.SIGKILL
        check()
    # Most runs were still at work.
    assert killed > KILLS / 2
    finish(run())
    check()


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def check_report(folder: Path, names: set[str]) -> None:
    """A report with its page is complete; times make its bytes differ from those of another run."""
    if (folder / "index.html").exists():
        found = contents(folder)
        assert set(found) == names
        assert json.loads(found["report.json"])
        assert found["index.html"].rstrip().endswith(b"</html>")
        assert all(data.endswith(b"\xff\xd9") for name, data in found.items() if name.endswith(".jpg"))


def test_thirty_kills_of_a_mosaic_with_tiles_and_report(folders: Path) -> None:
    pytest.importorskip("rasterio")
    photographs = folders / "photographs"

    def run(output: Path, cache: str) -> subprocess.Popen[str]:
        more = ("--tiles", output / "tiles", "--report", output / "report", "--cache", folders / cache)
        return start(folders, "mosaic", photographs, "-o", output / "mosaic.png", *more)

    seconds = finish(run(folders / "fresh", "cache of the fresh one"))
    fresh, out = folders / "fresh", folders / "out"
    picture, tiles = (fresh / "mosaic.png").read_bytes(), contents(fresh / "tiles")

    def check() -> None:
        assert not (out / "mosaic.png").exists() or (out / "mosaic.png").read_bytes() == picture
        # A page comes last, and goes first.
        assert not (out / "tiles" / "index.html").exists() or contents(out / "tiles") == tiles
        check_report(out / "report", set(contents(fresh / "report")))

    kill_again_and_again(lambda: run(out, "cache"), check, seconds)
    assert {path.name for path in out.iterdir()} == {"mosaic.png", "tiles", "report"}
    assert contents(out / "tiles") == tiles
    assert not list((folders / "temp").iterdir())


def test_thirty_kills_of_a_live_mosaic(folders: Path) -> None:
    def run(output: Path) -> subprocess.Popen[str]:
        return start(folders, "live", folders / "photographs", "-o", output / "grown.png", "--idle-seconds", 1)

    seconds = finish(run(folders / "fresh"))
    fresh, out = contents(folders / "fresh"), folders / "out"

    def check() -> None:
        # The preview is replaced once a second; each one is a whole picture.
        assert not (out / "grown.png").exists() or (out / "grown.png").read_bytes() == fresh["grown.png"]
        if (out / "grown.preview.jpg").exists():
            assert (out / "grown.preview.jpg").read_bytes().endswith(b"\xff\xd9")

    kill_again_and_again(lambda: run(out), check, seconds)
    assert set(contents(out)) == set(fresh)
    assert not list((folders / "temp").iterdir())
