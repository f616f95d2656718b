"""Small modules of imagery: pictures in notebooks, parcels, frames as they come, outputs that are no photographs."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.imagery.depth import ValueRange, measure_range, show_in_8_bit
from skymosaic.imagery.images import save
from skymosaic.imagery.live_frames import read_live_frames
from skymosaic.imagery.own_outputs import record_output
from skymosaic.imagery.parcel import Parcel
from skymosaic.imagery.photographs import list_sources

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    "pixels",
    [
        RNG.integers(0, 256, (7, 5, 3), np.uint8),
        RNG.integers(0, 65536, (7, 5, 4), np.uint16),
        RNG.random((6, 4)) > 0.5,
        RNG.integers(0, 256, (9, 8), np.uint8)[:, ::2],
        (RNG.random((9, 8)) > 0.5)[1:, ::2],
        RNG.integers(0, 65536, 9),
        np.zeros((0, 0), np.uint8),
    ],
    ids=lambda pixels: f"{pixels.dtype} {pixels.shape}",
)
def test_pixels_survive_the_way(pixels: Any) -> None:
    again = pickle.loads(pickle.dumps(Parcel(pixels))).pixels
    np.testing.assert_array_equal(again, pixels)
    assert again.dtype == pixels.dtype


@pytest.mark.parametrize("source", ["99999999999", "9" * 5000, "100"], ids=len)
def test_a_number_that_no_camera_has_is_the_name_of_a_file(source: str) -> None:
    with pytest.raises(InputError, match="check the path"):
        next(read_live_frames(source, idle_seconds=0, tell=lambda _line: None))


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


def test_pixels_are_shown_in_the_range_of_the_flight() -> None:
    values, shown = ValueRange(0, 510), np.array([[0, 20, 255]], np.uint8)
    np.testing.assert_array_equal(show_in_8_bit(shown, values), shown)
    np.testing.assert_array_equal(show_in_8_bit(shown, None), shown)
    np.testing.assert_array_equal(show_in_8_bit(shown.astype(np.uint16) * 2, values), shown)
    own, flight = ValueRange(10_000, 20_000), ValueRange(0, 40_000)
    np.testing.assert_array_equal(own.show_as(np.array([[0, 255]], np.uint8), flight), [[64, 128]])
    shown = np.array([[0, 51, 255]], np.uint8)
    np.testing.assert_array_equal(ValueRange(0, 65_535).to_16_bit(shown), [[0, 13_107, 65_535]])
    np.testing.assert_array_equal(ValueRange(-500, 70_000).to_16_bit(shown), [[0, 13_600, 65_535]])


def test_the_error_for_signed_pixels_says_what_can_be_read() -> None:
    with pytest.raises(
        InputError, match=r"a\.tif: pixels of int16 are not supported; convert them to unsigned 8 or 16"
    ):
        measure_range(np.zeros((64, 64), np.int16), "a.tif")
