from pathlib import Path

import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.imagery.images import save
from skymosaic.imagery.live_frames import read_live_frames


@pytest.mark.parametrize("source", ["99999999999", "9" * 5000, "100"], ids=len)
def test_a_number_that_no_camera_has_is_the_name_of_a_file(source: str) -> None:
    with pytest.raises(InputError, match="check the path"):
        next(read_live_frames(source, idle_seconds=0, tell=lambda _line: None))


def test_a_folder_may_be_named_by_a_year(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (folder := Path("2024")).mkdir()
    save(folder / "1.png", np.zeros((64, 64), np.uint8))
    monkeypatch.setattr("skymosaic.imagery.live_frames.SETTLED_SECONDS", 0)
    # Without waiting for more, what is there already comes nevertheless.
    (frame,) = read_live_frames("2024", idle_seconds=0, tell=lambda _line: None)
    assert frame.name == str(folder / "1.png")


def test_a_file_that_is_complete_at_last_is_no_longer_unusable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skymosaic.imagery.live_frames.SETTLED_SECONDS", 0)
    for name in ("1.png", "2.png", "3.png"):
        save(tmp_path / name, np.zeros((64, 64), np.uint8))
    for name in ("1.png", "3.png"):
        (tmp_path / name).write_bytes(b"half of it")
    unusable: dict[str, str] = {}
    frames = read_live_frames(str(tmp_path), idle_seconds=0, tell=lambda _line: None, unusable=unusable)
    next(frames)
    assert list(unusable) == [str(tmp_path / "1.png")]
    save(tmp_path / "1.png", np.zeros((64, 64), np.uint8))
    list(frames)
    assert list(unusable) == [str(tmp_path / "3.png")]
    assert unusable[str(tmp_path / "3.png")].startswith(f"{tmp_path / '3.png'}: not an image")
