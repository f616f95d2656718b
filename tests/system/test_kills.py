"""A flight that is killed again and again ends with the same bytes, and leaves nothing."""

import os
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.scene import make_lawnmower

KILLS = 30
MAX_SECONDS = 6.0


def command(folder: Path, output: Path, cache: Path) -> list[str]:
    words = ("mosaic", folder, "-o", output, "--overwrite", "--cache", cache)
    return [sys.executable, "-m", "skymosaic", *map(str, words)]


@pytest.mark.slow
def test_thirty_kills_at_random_moments(tmp_path: Path) -> None:
    folders = {name: tmp_path / name for name in ("photographs", "out", "temp")}
    for folder in folders.values():
        folder.mkdir()
    for number, image in enumerate(make_lawnmower(3, 9, (400, 300)).images):
        cv2.imwrite(str(folders["photographs"] / f"IMG_{number}.png"), image)
    environment = {**os.environ, "TMPDIR": str(folders["temp"]), "PYTHONPATH": str(Path(__file__).parents[2])}

    def run(output: Path, cache: str) -> subprocess.Popen[str]:
        words = command(folders["photographs"], output, tmp_path / cache)
        return subprocess.Popen(words, stderr=subprocess.PIPE, text=True, env=environment)

    whole = run(tmp_path / "whole.png", "fresh")
    assert whole.communicate()[1] is not None
    expected = (tmp_path / "whole.png").read_bytes()
    rng = np.random.default_rng(16)
    output = folders["out"] / "mosaic.png"
    for seconds in rng.uniform(0.1, MAX_SECONDS, KILLS):
        process = run(output, "killed")
        time.sleep(seconds)
        process.kill()
        process.communicate()
        assert not output.exists() or output.read_bytes() == expected
    last = run(output, "killed")
    errors = last.communicate()[1]
    assert last.returncode == 0, errors
    assert output.read_bytes() == expected
    assert [path.name for path in folders["out"].iterdir()] == ["mosaic.png"]
    assert not list(folders["temp"].iterdir())
