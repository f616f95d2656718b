"""Inputs and mosaics as the page shows them: thumbnails, working pictures, tiles and the built-in examples."""

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.compositing.layer import SeamMask
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.picture.composition import Composition, Placement
from skymosaic.imagery.key_frames import DEFAULT_RATE
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.parcel import Parcel
from skymosaic.imagery.photographs import Source
from skymosaic.imagery.video import write_video
from skymosaic.panel.tasks import mosaic_picture, upload_tasks
from skymosaic.panel.tasks.mosaic_picture import show_mosaic

MOSAIC = cv2.GaussianBlur(np.random.default_rng(2).integers(0, 256, (700, 1200, 3), np.uint8), (0, 0), 4)


def delivery(image: np.ndarray) -> Any:
    """A mosaic whose canvas begins at (-100, 50); one photograph shows in a rectangle of it."""
    mask = np.zeros((40, 60), np.uint8)
    mask[10:20, 30:50] = 255
    seam = SeamMask(Parcel(mask), Canvas(-10, 5, 60, 40), 0.1)
    source = Source(0, "a.jpg", Path("a.jpg"))
    placements = (Placement(source, (200, 100), np.eye(3), seam=seam), Placement(source, (200, 100), np.eye(3)))
    canvas = Canvas(-100, 50, image.shape[1], image.shape[0])
    composition = Composition(placements, canvas, coloured=True, blending="multiband", lens=Lens())
    return SimpleNamespace(preview=image, composition=composition)


def test_tiles_are_parts_of_the_mosaic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mosaic_picture, "PICTURE_SIDE_PX", 300)
    shown = show_mosaic(delivery(MOSAIC), tmp_path)
    assert (shown.picture.width, shown.picture.height) == (300, 175)
    assert sorted({tile.scale for tile in shown.tiles}) == [0.25, 0.5]
    for scale in (0.25, 0.5):
        whole = cv2.resize(MOSAIC, None, fx=0.25 / scale, fy=0.25 / scale, interpolation=cv2.INTER_AREA)
        covered = np.zeros(whole.shape[:2], bool)
        for tile in (tile for tile in shown.tiles if tile.scale == scale):
            pixels = np.asarray(cv2.imread(str(tmp_path / Path(tile.href).name)))
            x, y = round(tile.x / scale), round(tile.y / scale)
            part = slice(y, y + len(pixels)), slice(x, x + pixels.shape[1])
            assert (tile.width / scale, tile.height / scale) == (pixels.shape[1], len(pixels))
            assert np.abs(whole[part].astype(int) - pixels).mean() < 3
            covered[part] = True
        assert covered.all()


def test_a_small_mosaic_has_no_tiles_and_seams_where_photographs_show(tmp_path: Path) -> None:
    shown = show_mosaic(delivery(MOSAIC), tmp_path)
    assert shown.tiles == ()
    assert [path.name for path in tmp_path.iterdir()] == ["mosaic.jpg"]
    (line,) = show_mosaic(delivery(MOSAIC), tmp_path).seams
    # Mask pixels 30..49, 10..19 of a frame at (-10, 5) whose pixels are 10 of the mosaic's, on a canvas at (-100, 50).
    assert np.allclose(line.min(axis=0), (304.5, 104.5))
    assert np.allclose(line.max(axis=0), (494.5, 194.5))


Steps = list[tuple[object, ...]]


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    (tmp_path / "pictures").mkdir()
    return tmp_path / "pictures"


def write(folder: Path, name: str, width: int, height: int) -> str:
    """A picture that is red on its left half and blue on its right one."""
    picture = np.zeros((height, width, 3), np.uint8)
    picture[:, : width // 2, 2] = picture[:, width // 2 :, 0] = 220
    cv2.imwrite(str(folder / name), picture)
    return name


@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_thumbnails_show_all_photographs_but_those_that_cannot_be_read(
    tmp_path: Path, pictures: Path, suffix: str
) -> None:
    """A JPEG is decoded at an eighth, a quarter or half of its size, as long as a thumbnail is not larger."""
    shown = {(1280, 1280): (160, 160), (1279, 1279): (160, 160), (640, 700): (160, 175), (320, 330): (160, 165),
             (319, 300): (160, 150), (100, 90): (100, 90)}  # fmt: skip
    names = [write(tmp_path, f"{number}.{suffix}", *size) for number, size in enumerate(shown)]
    (tmp_path / "broken.png").write_bytes(b"no picture")
    steps: Steps = []
    faults = upload_tasks.make_thumbnails(
        tmp_path, [*names, "broken.png"], pictures, progress=lambda *step: steps.append(step)
    )
    assert [fault.partition(": ")[0] for fault in faults] == [str(tmp_path / "broken.png")]
    assert steps == [("reading", number, 7) for number in range(1, 8)]
    for number, size in enumerate(shown.values(), 1):
        thumbnail: Any = cv2.imread(str(pictures / f"{number}.jpg"))
        assert thumbnail.shape[1::-1] == size
        left, right = thumbnail[:, : size[0] // 3].mean(axis=(0, 1)), thumbnail[:, -size[0] // 3 :].mean(axis=(0, 1))
        assert (left.argmax(), right.argmax()) == (2, 0)


def test_a_photograph_is_described_by_its_size_and_its_working_picture(tmp_path: Path, pictures: Path) -> None:
    name = write(tmp_path, "wide.png", 2560, 600)
    found = upload_tasks.inspect_photograph(tmp_path, name, pictures, progress=lambda *_: None)
    assert (found.size, found.working_size, found.notes) == ((2560, 600), (1280, 300), ())
    working: Any = cv2.imread(str(found.working))
    assert (found.working.parent, working.shape) == (pictures, (300, 1280, 3))
    # Its file is never that of another photograph, not even of one with the same name.
    assert upload_tasks.inspect_photograph(tmp_path, name, pictures, progress=lambda *_: None).working != found.working


def test_a_large_jpeg_is_reduced_whatever_its_name(tmp_path: Path, pictures: Path) -> None:
    names = [os.fsdecode(b"S\xfcd #1?%20&\n\\.jpg"), "n" * 251 + ".jpg"]
    for name in names:
        (tmp_path / write(tmp_path, "a.jpg", 640, 640)).rename(tmp_path / name)
    assert upload_tasks.make_thumbnails(tmp_path, names, pictures, progress=lambda *_: None) == []
    assert {path.name for path in pictures.iterdir()} == {"1.jpg", "2.jpg"}


@pytest.mark.parametrize("room_px", [0, -1])
def test_a_video_may_have_frames_of_a_quarter_of_the_largest_photograph(
    tmp_path: Path, pictures: Path, monkeypatch: pytest.MonkeyPatch, room_px: int
) -> None:
    monkeypatch.setattr(upload_tasks, "MAX_AREA_PX", 4 * (96 * 64 + room_px))
    with write_video(tmp_path / "film.mp4", DEFAULT_RATE) as write_frame:
        for _ in range(2):
            write_frame(np.full((64, 96, 3), 90, np.uint8))
    if room_px < 0:
        with pytest.raises(InputError, match=r"film\.mp4: frames of 96x64 pixels are too large; reduce it first"):
            upload_tasks.inspect_video(tmp_path, "film.mp4", pictures, progress=lambda *_: None)
    else:
        found = upload_tasks.inspect_video(tmp_path, "film.mp4", pictures, progress=lambda *_: None)
        assert (found.size, found.notes) == ((96, 64), (f"{float(DEFAULT_RATE):.3g} frames/s",))
