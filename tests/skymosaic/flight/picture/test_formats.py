import contextlib
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.compositing.warp import CANVAS_LIMIT_PX, Canvas, enclosing_canvas
from skymosaic.flight.picture.composition import Room
from skymosaic.flight.picture.formats import PLAIN, OutputForm, check_size, numbered, room_for
from skymosaic.geometry.homography import resize_matrix


def leave_free(monkeypatch: pytest.MonkeyPatch, free_bytes: int) -> None:
    usage: Any = SimpleNamespace(free=free_bytes)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage)


def test_a_mosaic_grows_as_the_file_and_the_disk_allow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leave_free(monkeypatch, 24_000_000_000)
    survey = Canvas(0, 0, 28_000, 20_000)
    for suffix, share in ((".tif", 1.0), (".png", 1.0), (".jpg", np.sqrt(250 / 560)), (".webp", 16_383 / 28_000)):
        assert room_for(tmp_path / f"m{suffix}", 4).share_of(survey) == pytest.approx(share, rel=2e-3)
    assert room_for(tmp_path / "m.bmp", 4).area_px == CANVAS_LIMIT_PX
    assert room_for(tmp_path / "m.jpg", 4).share_of(Canvas(0, 0, 131_000, 10)) == pytest.approx(0.5, rel=2e-3)
    leave_free(monkeypatch, 3_360_000_000)
    room = room_for(tmp_path / "m.tif", 4)
    assert room.share_of(survey) == pytest.approx(0.5, rel=2e-3)
    assert room.reason == "the disk has 3204 MB left"
    # Of files whose pixels are in memory, too.
    leave_free(monkeypatch, 40_000_000)
    for suffix in (".jpg", ".webp", ".bmp"):
        room = room_for(tmp_path / f"m{suffix}", 4)
        assert (room.area_px, room.reason) == (10_000_000, "the disk has 38 MB left")
    assert room_for(tmp_path / "m.webp", 4).side_px == 16_383


@pytest.mark.parametrize("size_px", [(1_000_000, 20), (1001, 1001), (3, 900_000)])
def test_a_reduced_canvas_keeps_to_its_room(size_px: tuple[int, int]) -> None:
    # A band is reduced to few rows, of which rounding adds one.
    for area_px in (1e6, 1000, 10):
        smaller = resize_matrix(Room(area_px=area_px).share_of(Canvas(0, 0, *size_px)))
        enclosing_canvas([size_px], [smaller], limit_px=area_px)


def test_a_canvas_that_just_fits_is_not_reduced() -> None:
    room = Room(area_px=1e6, side_px=1000)
    assert room.share_of(Canvas(0, 0, 1000, 1000)) == 1
    assert 0.99 < room.share_of(Canvas(0, 0, 1001, 999)) < 0.9991


TILES = Path("tiles")


@pytest.mark.parametrize(
    ("name", "form", "bands", "says"),
    [
        ("m.xyz", OutputForm(), 0, "m.xyz: unknown kind of file; end the name in one of .png, .jpg, .jpeg, .tif, "),
        ("m.tif", OutputForm("zip"), 0, "`compress` is 'zip'; valid: deflate, jpeg"),
        ("m.jpg", OutputForm(), 5, "m.jpg: a mosaic of 5 bands must be a .tif"),
        ("m.TIFF", OutputForm(), 5, ""),
        ("m.tif", OutputForm("jpeg"), 5, "compression and tiles are for photographs, not for multi-band sets"),
        ("m.tif", OutputForm(tiles=TILES), 5, "compression and tiles are for photographs, not for multi-band sets"),
        ("m.png", OutputForm("jpeg"), 0, "m.png: jpeg compression is for .tif; leave it out, or end the name in .tif"),
        ("m.tif", OutputForm("jpeg", TILES), 0, ""),
        ("m.png", OutputForm(require_map=True), 0, "m.png: .png files are no maps, and a map is required"),
        ("m.png", OutputForm(tiles=TILES, require_map=True), 0, ""),
        ("m.tif", OutputForm(require_map=True), 0, ""),
        ("m.kmz", OutputForm(require_map=True), 0, ""),
        ("m.kmz", OutputForm(), 5, "m.kmz: a mosaic of 5 bands must be a .tif"),
        ("m.mbtiles", OutputForm("jpeg"), 0, "m.mbtiles: jpeg compression is for .tif; leave it out"),
        ("m.png", OutputForm(), 0, ""),
    ],
)
def test_what_cannot_apply_to_a_file_is_refused(name: str, form: OutputForm, bands: int, says: str) -> None:
    with pytest.raises(InputError) if says else contextlib.nullcontext() as refused:
        form.check(Path(name), bands)
    assert refused is None or str(refused.value).startswith(says)


@pytest.mark.parametrize(
    ("name", "size", "says"),
    [
        ("m.webp", (16_383, 16_383), ""),
        ("m.WEBP", (16_384, 10), "m.WEBP: 16384x10 cannot be stored as .WEBP, whose sides have at most 16,383 pixels"),
        ("m.jpg", (10, 65_500), ""),
        ("m.jpeg", (10, 65_501), "m.jpeg: 10x65501 cannot be stored as .jpeg, whose sides have at most 65,500 pixels"),
        ("m.png", (100_000, 10), ""),
        ("m.tif", (100_000, 10), ""),
    ],
)
def test_a_size_that_a_file_cannot_hold_is_refused(name: str, size: tuple[int, int], says: str) -> None:
    with pytest.raises(InputError) if says else contextlib.nullcontext() as refused:
        check_size(Path(name), size)
    assert refused is None or str(refused.value) == f"{says}; use .png or .tif"


def test_outputs_of_several_groups_are_numbered_from_the_second_on() -> None:
    form = OutputForm("jpeg", Path("site/tiles"))
    assert form.numbered(1) == form
    assert form.numbered(2) == OutputForm("jpeg", Path("site/tiles_2"))
    assert PLAIN.numbered(2) == PLAIN
    assert numbered(Path("a/m.v2.tif"), 3) == Path("a/m.v2_3.tif")
