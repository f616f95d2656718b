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
    frame = next(read_live_frames("2024", idle_seconds=9, tell=lambda _line: None))
    assert frame.name == str(folder / "1.png")
