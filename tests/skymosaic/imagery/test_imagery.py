"""Small modules of imagery: pictures in notebooks, parcels, frames as they come, outputs that are no photographs."""

import base64
import hashlib
import pickle
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from skymosaic.common.errors import InputError
from skymosaic.imagery.band_writer import write_png
from skymosaic.imagery.depth import ValueRange, measure_common_range, measure_range, sample_values, show_in_8_bit
from skymosaic.imagery.images import load, save
from skymosaic.imagery.live_frames import read_live_frames
from skymosaic.imagery.notebook import describe_in_html, draw_lines
from skymosaic.imagery.own_outputs import record_output
from skymosaic.imagery.parcel import Parcel
from skymosaic.imagery.photographs import list_sources


def test_a_notebook_shows_a_picture_and_at_most_200_lines() -> None:
    assert describe_in_html("2 < 3") == "<p>2 &lt; 3</p>"
    shown = describe_in_html("2 < 3", np.full((500, 1600, 3), (10, 120, 240), np.uint8))
    found = re.fullmatch(r'<p>2 &lt; 3</p><img alt="2 &lt; 3" src="data:image/jpeg;base64,(.+)">', shown)
    assert found
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(found[1]), np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.shape == (250, 800, 3)
    np.testing.assert_allclose(pixels[100, 100].astype(int), (10, 120, 240), atol=3)
    pictures = np.zeros((1000, 800, 3), np.uint8), np.zeros((1000, 800, 3), np.uint8)
    rows = np.arange(400, dtype=np.float64) * 2 + 50
    points = np.column_stack([np.full(400, 700.0), rows])
    drawn = draw_lines(pictures, (points, points))
    assert drawn.shape == (500, 800, 3)
    # Every third of them, at half its place; lines are smooth at their edges.
    assert np.flatnonzero(drawn[:, 500, 1] > 128).tolist() == list(range(25, 25 + 3 * 134, 3))


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


def bands_of(picture: np.ndarray, rows: int = 64) -> list[np.ndarray]:
    return [picture[top : top + rows] for top in range(0, len(picture), rows)]


def noise(height: int, width: int, *channels: int) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (height, width, *channels), dtype=np.uint8)


@pytest.mark.parametrize("channels", [(), (3,)], ids=["gray", "bgr"])
def test_bands_read_back_as_the_picture(tmp_path: Path, channels: tuple[Any, ...]) -> None:
    picture = noise(150, 67, *channels)
    path = tmp_path / "picture.png"
    write_png(path, (67, 150), len(channels) * 2 + 1, bands_of(picture))
    np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), picture)
    with Image.open(path) as opened:
        rgb = np.asarray(opened)
    np.testing.assert_array_equal(rgb, picture[..., ::-1] if channels else picture)


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
    assert frame.photograph.name == str(folder / "1.png")


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


def test_a_folder_that_is_listed_again_and_again_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("IMG_1.png", "mosaic.png"):
        (tmp_path / name).write_bytes(name.encode())
    record_output(tmp_path / "mosaic.png", [tmp_path])
    assert len(list_sources([tmp_path])) == 1
    monkeypatch.setattr(hashlib, "file_digest", lambda *_: pytest.fail("read again"))
    assert len(list_sources([tmp_path])) == 1


def test_the_range_of_a_flight_is_measured_on_even_samples() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        deep = rng.integers(0, 1 << 16, (rng.integers(70, 100), 83), dtype=np.uint16)
        values = measure_range(deep, "deep")
        np.testing.assert_allclose((values.low, values.high), np.percentile(deep, (0.1, 99.9)))
    dark, bright = (sample_values(np.full((300, 400), level, np.uint16)) for level in (9000, 50_000))
    assert measure_common_range([dark, bright]) == ValueRange(9000, 50_000, deep=True)
    assert measure_common_range([dark, dark[:0].astype(np.uint8)]) == ValueRange(9000, 9000, deep=False)
    assert measure_common_range([dark[:0]]) is None
    coloured = sample_values(np.full((300, 400, 3), (100, 9000, 9000), np.uint16))
    assert measure_common_range([coloured, bright]) == ValueRange(100, 50_000, deep=True)
    pixels = np.arange(512 * 255, dtype=np.float32).reshape(512, 255)
    pixels[2, 7] = np.nan
    expected = pixels[2::4].ravel()
    np.testing.assert_array_equal(sample_values(pixels), expected[np.isfinite(expected)])
    np.testing.assert_array_equal(sample_values(pixels[:, :256].T), pixels.T[:, 2::4][np.isfinite(pixels.T[:, 2::4])])


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


@pytest.mark.parametrize("values", [ValueRange(0, 40_000), ValueRange(0, 40_000, deep=True)])
def test_the_same_number_is_shown_alike_in_all_photographs(tmp_path: Path, values: ValueRange) -> None:
    for name, brightest in (("dark", 20_000), ("bright", 40_000)):
        ramp = np.linspace(0, brightest, 64 * 80).reshape(64, 80).astype(np.uint16)
        ramp[0, 0] = 10_000
        cv2.imwrite(str(tmp_path / f"{name}.tif"), ramp)
    shown = [load(tmp_path / f"{name}.tif", name, values).pixels[0, 0] for name in ("dark", "bright")]
    assert shown == [10_000 if values.deep else 64] * 2
    own = [load(tmp_path / f"{name}.tif").pixels[0, 0] for name in ("dark", "bright")]
    assert own[0] != own[1]
    pixels = np.full((64, 80), 7, np.uint8)
    np.testing.assert_array_equal(load(pixels, "image 3", values).pixels, pixels)
    cv2.imwrite(str(tmp_path / "plain.tif"), pixels)
    np.testing.assert_array_equal(load(tmp_path / "plain.tif", "plain", values).pixels, pixels)


def test_libtiff_is_silent_about_tags_it_does_not_know(tmp_path: Path) -> None:
    picture = Image.fromarray(np.zeros((80, 80), np.uint16))
    picture.save(tmp_path / "t.tif", tiffinfo={50_000: "private"})
    code = "import sys; from skymosaic.imagery.images import load; load(sys.argv[1])"
    run = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "t.tif")], capture_output=True, text=True, check=True
    )
    assert run.stderr == ""


def test_the_error_for_signed_pixels_says_what_can_be_read() -> None:
    with pytest.raises(
        InputError, match=r"a\.tif: pixels of int16 are not supported; convert them to unsigned 8 or 16"
    ):
        measure_range(np.zeros((64, 64), np.int16), "a.tif")
