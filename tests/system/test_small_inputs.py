"""Pipes, devices and huge files under the names of small inputs: one line, at once."""

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from golden_model.cache import Cache
from golden_model.config_file import load_config
from golden_model.fuzzy.fll import load_system
from skymosaic.common.errors import InputError
from skymosaic.imagery.lens import load_lens
from skymosaic.imagery.photographs import list_sources
from skymosaic.imagery.video import VideoReader
from skymosaic.maps.control_points import load_control_points

READERS: dict[str, Callable[[Path], object]] = {
    "a.toml": load_config,
    "camera.toml": lambda path: load_lens(path, None),
    "gcp_list.txt": load_control_points,
    "rules.fll": load_system,
    "photograph.jpg": lambda path: list_sources([path])[0].digest,
    "mask.png": lambda path: load_lens(None, path),
    "film.mp4": VideoReader,
}


def pipe(path: Path) -> None:
    os.mkfifo(path)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def huge(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(3_000_000_000)


@pytest.fixture(autouse=True)
def no_hang() -> Iterator[None]:
    """Of processor time: a busy machine is no fault. Only a pipe is waited for without it, until the alarm."""

    def end(*_: object) -> None:
        raise TimeoutError("it hangs")

    before = [signal.signal(each, end) for each in (signal.SIGALRM, signal.SIGPROF)]
    signal.setitimer(signal.ITIMER_PROF, 5)
    signal.alarm(300)
    yield
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.alarm(0)
    for number, handler in zip((signal.SIGALRM, signal.SIGPROF), before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("make", [pipe, device, huge])
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_small_file_is_one_line(tmp_path: Path, name: str, make: Callable[[Path], None]) -> None:
    make(tmp_path / name)
    with pytest.raises(
        (InputError, ValueError), match=r"not a regular file|not a file|larger than|not an image|not a readable video"
    ) as caught:
        READERS[name](tmp_path / name)
    assert str(caught.value).startswith(f"{tmp_path / name}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("make", [pipe, device, huge])
def test_such_a_cache_entry_counts_as_missing(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / "a.entry")
    cache = Cache(tmp_path)
    assert cache.load("a") is None
    (tmp_path / "a.entry").unlink()
    cache.save("a", {"x": np.arange(3)})
    assert cache.load("a") is not None
