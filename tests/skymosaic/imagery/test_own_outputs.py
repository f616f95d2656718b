import hashlib
from pathlib import Path

import pytest

from skymosaic.imagery.own_outputs import record_output
from skymosaic.imagery.photographs import list_sources


@pytest.mark.parametrize("mosaic", ["mosaic.png", "two\nlines.png", "no UTF-8 \udcff.png"])
def test_a_folder_does_not_give_an_earlier_mosaic(tmp_path: Path, mosaic: str) -> None:
    for name in ("IMG_1.png", "IMG_2.png", mosaic, "another.png"):
        (tmp_path / name).write_bytes(b"a picture")
    for name in (mosaic, "another.png"):
        record_output(tmp_path / name, [tmp_path])
    assert [source.name.rsplit("/")[-1] for source in list_sources([tmp_path])] == ["IMG_1.png", "IMG_2.png"]
    (tmp_path / mosaic).write_bytes(b"a photograph of that name")
    assert len(list_sources([tmp_path])) == 3


def test_a_pattern_does_not_give_an_earlier_mosaic_but_its_name_does(tmp_path: Path) -> None:
    for name in ("IMG_1.png", "IMG_2.png", "mosaic.png"):
        (tmp_path / name).write_bytes(name.encode())
    record_output(tmp_path / "mosaic.png", [tmp_path])
    told: list[str] = []
    assert [Path(source.name).name for source in list_sources(tmp_path / "*.png", told.append)] == [
        "IMG_1.png",
        "IMG_2.png",
    ]
    assert told == []
    for named in ("mosaic.png", "mos*.png"):
        assert [Path(source.name).name for source in list_sources(tmp_path / named, told.append)] == ["mosaic.png"]
        assert told.pop().startswith(f"note {tmp_path / 'mosaic.png'}: an earlier mosaic")
    assert list_sources("no\0folder/x.png")[0].name == "no\0folder/x.png"


def test_other_folders_of_outputs_stay_as_they_are(tmp_path: Path) -> None:
    (tmp_path / "mosaic.png").write_bytes(b"x")
    record_output(tmp_path / "mosaic.png", [tmp_path / "photographs"])
    assert [path.name for path in tmp_path.iterdir()] == ["mosaic.png"]


def test_a_folder_that_is_listed_again_and_again_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("IMG_1.png", "mosaic.png"):
        (tmp_path / name).write_bytes(name.encode())
    record_output(tmp_path / "mosaic.png", [tmp_path])
    assert len(list_sources([tmp_path])) == 1
    monkeypatch.setattr(hashlib, "file_digest", lambda *_: pytest.fail("read again"))
    assert len(list_sources([tmp_path])) == 1
