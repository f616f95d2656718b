"""A disk that is full at any moment of any command: outputs are whole or absent, and only what had no room is lost."""

import builtins
import errno
import functools
import io
import json
import os
import resource
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from sim.scene import make_lawnmower, make_pair
from skymosaic.imagery.video import VideoReader, write_video
from tests.conftest import Run
from tests.system.command_line import only_error

PAIR = "mosaic pair/left.png pair/right.png -o out/m.png --report out/report --tiles out/tiles"
COMMANDS = {
    "pair": PAIR,
    "track": "track film.mkv --roi 40,40,160,120 -o out/t.mp4 --corners out/c.csv",
    "rules": "fuzzy aerial --write out/a.fll",
    "flight": "mosaic flight -o out/m.tif --report out/report --tiles out/tiles --cache cache",
    "live": "live flight -o out/m.png --idle-seconds 0.1",
    "plot": "fuzzy ransac --plot -o out/plots",
    "demo": "demo -o out/demo --backend golden",
}
FAST = {"pair": 5, "track": 1, "rules": 1}
"""Commands of the fast tests, and which of their files have no room: each, or each fifth."""
LATER = {
    "pair": ("out/report", "out/tiles"),
    "flight": ("out/report", "out/tiles"),
    "track": ("out/t.mp4", "out/c.csv"),
}
"""What is lost alone: of most commands what comes after the first output."""


@functools.cache
def render() -> tuple[list[Pixels], list[Pixels]]:
    """A pair and a flight."""
    return list(make_pair(seed=9, size=(240, 180)).images), list(make_lawnmower(9, 6, (400, 300)).images)


@pytest.fixture(autouse=True)
def _inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for folder in ("flight", "pair"):
        Path(folder).mkdir()
    pair, views = render()
    pictures = dict(zip(("pair/left", "pair/right"), pair, strict=True))
    for name, image in {**pictures, **{f"flight/{n}": image for n, image in enumerate(views)}}.items():
        cv2.imwrite(f"{name}.png", image)
        # Complete for long, so that nobody waits for the rest.
        os.utime(f"{name}.png", (0, 0))
    with write_video(Path("film.mkv"), Fraction(25)) as write:
        for step in range(4):
            write(np.ascontiguousarray(views[0][:240, 4 * step : 4 * step + 320]))


class Disk:
    """Counts files and folders as they are made, and has no room for one of them."""

    def __init__(self, full_at: int = -1) -> None:
        self.made, self._full_at = 0, full_at

    @contextmanager
    def mounted(self) -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            for module, name in ((os, "open"), (os, "mkdir"), (io, "open"), (builtins, "open")):
                patch.setattr(module, name, self._counting(getattr(module, name), name))
            yield

    def _counting(self, make: Callable[..., Any], name: str) -> Callable[..., Any]:
        def counted(path: Any, *rest: Any, **more: Any) -> Any:
            mode = rest[0] if rest else more.get("mode", more.get("flags", "r"))
            writes = mode & os.O_CREAT if isinstance(mode, int) else set("wxa") & set(mode)
            if name == "mkdir" or writes:
                self.made += 1
                if self.made == self._full_at:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
            return make(path, *rest, **more)

        return counted


def contents(folder: Path) -> dict[str, bytes]:
    """What each file holds; of those that a run's duration or its threads change, whether they are complete."""
    files = {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
    films = {name: str(sum(1 for _ in VideoReader(name))).encode() for name in files if name.endswith(".mp4")}
    pages = {name: data[-3:] for name, data in files.items() if name.endswith(("index.html", "report.json"))}
    return {**files, **films, **pages}


def attempt(run: Run, words: str, disk: Disk) -> tuple[dict[str, bytes], list[str], int]:
    """The files that a command has made, the outputs that it names, and its status."""
    subprocess.run(["rm", "-rf", "out"], check=True)
    Path("out").mkdir()
    with disk.mounted():
        status, out, errors = run(*words.split(), "--json")
    if status:
        assert status == 2
        assert "No space left on device" in only_error(errors) or "File too large" in only_error(errors)
    assert "Traceback" not in errors
    return contents(Path("out")), json.loads(out.splitlines()[-1])["outputs"], status


def check(whole: dict[str, bytes], found: dict[str, bytes], named: list[str]) -> None:
    """Each file is as it should be, and those that a command names are all that there are."""
    assert {name for name, data in found.items() if whole[name] != data} == set()
    for name in named:
        assert Path(name).exists()
    assert all(any(Path(each) in (Path(name), *Path(name).parents) for each in named) for name in found), named


@pytest.mark.parametrize(
    "words", [*(f"mosaic pair/left.png pair/right.png -o out/m.{name}" for name in ("tif", "png")), COMMANDS["track"]]
)
def test_a_file_that_grows_beyond_its_room_is_not_there(run: Run, words: str) -> None:
    """As GDAL and FFmpeg meet it, which write by themselves, too; the table of a film that is not there is."""
    whole, (output, *others), _ = attempt(run, words, Disk())
    size = Path(output).stat().st_size
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    for share in (0.3, 0.99):
        for name in whole:
            Path(name).unlink(missing_ok=True)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(share * size), hard))
        try:
            status, _, errors = run(*words.split())
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
        assert status == 2
        assert only_error(errors).startswith(f"error: {output}: cannot be written (")
        assert contents(Path("out")) == {name: whole[name] for name in others}


@pytest.mark.parametrize(
    ("name", "step"),
    [*FAST.items(), *(pytest.param(name, 1, marks=pytest.mark.slow) for name in COMMANDS if FAST.get(name) != 1)],
)
def test_one_file_that_has_no_room_costs_one_output(run: Run, name: str, step: int) -> None:
    attempt(run, COMMANDS[name], Disk())
    whole, outputs, status = attempt(run, COMMANDS[name], disk := Disk())
    assert (status, bool(whole)) == (0, True)
    lost: set[str] = set()
    for number in range(1, disk.made + 1, step):
        found, named, status = attempt(run, COMMANDS[name], Disk(number))
        missing = set(outputs) - set(named)
        check(whole, found, named)
        assert bool(status) == bool(missing) or found.items() == whole.items() or name in ("live", "flight")
        if name == "track" or (outputs[0] in named and name in LATER):
            assert len(missing) <= 1, (number, missing)
            lost |= missing
    assert lost >= set(LATER.get(name, ()))
