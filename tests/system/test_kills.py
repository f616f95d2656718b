"""A command that is killed again and again: each output is whole or absent, and the last run leaves nothing else."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.scene import make_lawnmower

KILLS = 30
pytestmark = pytest.mark.slow


def finish(process: subprocess.Popen[str]) -> float:
    """Wait for a run that must end by itself; returns the seconds that it took."""
    started = time.monotonic()
    errors = process.communicate()[1]
    assert process.returncode == 0, errors
    assert "error" not in errors
    return time.monotonic() - started


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_thirty_kills_of_a_mosaic_with_tiles_and_report(tmp_path: Path) -> None:
    pytest.importorskip("rasterio")
    fresh, out, temp, photographs = (tmp_path / name for name in ("fresh", "out", "temp", "photographs"))
    for folder in (fresh, out, temp, photographs):
        folder.mkdir()
    for number, image in enumerate(make_lawnmower(3, 9, (400, 300)).images):
        cv2.imwrite(str(photographs / f"IMG_{number}.png"), image)

    def run(output: Path) -> subprocess.Popen[str]:
        more = ("--tiles", output / "tiles", "--report", output / "report", "--cache", output.with_suffix(".cache"))
        words = ("mosaic", photographs, "-o", output / "mosaic.png", *more, "--overwrite")
        environment = {**os.environ, "TMPDIR": str(temp), "PYTHONPATH": str(Path(__file__).parents[2])}
        command = [sys.executable, "-m", "skymosaic", *map(str, words)]
        return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)

    seconds = finish(run(fresh))
    picture, tiles = (fresh / "mosaic.png").read_bytes(), contents(fresh / "tiles")

    def check() -> None:
        assert not (out / "mosaic.png").exists() or (out / "mosaic.png").read_bytes() == picture
        # A page comes last, and goes first.
        assert not (out / "tiles" / "index.html").exists() or contents(out / "tiles") == tiles
        if (out / "report" / "index.html").exists():
            # Times make its bytes differ from those of another run.
            found = contents(out / "report")
            assert set(found) == set(contents(fresh / "report"))
            assert json.loads(found["report.json"])
            assert found["index.html"].rstrip().endswith(b"</html>")
            assert all(data.endswith(b"\xff\xd9") for name, data in found.items() if name.endswith(".jpg"))

    killed = 0
    for share in np.random.default_rng(16).uniform(0.02, 1, KILLS):
        process, started = run(out), time.monotonic()
        try:
            process.communicate(timeout=share * seconds)
            # Later runs find what earlier ones left in the cache.
            seconds = time.monotonic() - started
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            killed += process.returncode == -signal.SIGKILL
        check()
    # Most runs were still at work.
    assert killed > KILLS / 2
    finish(run(out))
    check()
    assert {path.name for path in out.iterdir()} == {"mosaic.png", "tiles", "report"}
    assert contents(out / "tiles") == tiles
    assert not list(temp.iterdir())
