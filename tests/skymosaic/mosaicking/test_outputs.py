"""What is refused before the work begins."""

import os
import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.flight.picture.composition import Room
from skymosaic.flight.picture.formats import PLAIN, OutputForm
from skymosaic.imagery.exif import Metadata, Position
from skymosaic.imagery.photographs import Source
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.mosaicking.outputs import check_outputs, check_room, room_of
from skymosaic.mosaicking.run import MosaicRun


def check(run: MosaicRun, output: Path, form: OutputForm = PLAIN, **limits: Any) -> None:
    check_outputs(output, form, run.sources, run.options, **limits)


def test_a_full_disk_is_refused_before_the_first_feature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage: Any = SimpleNamespace(free=20_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage)
    photographs = [np.zeros((60, 80), np.uint8)] * 3
    with open_run(photographs, MosaicOptions()) as run:
        with pytest.raises(InputError, match=r"m\.tif: the disk has 19 MB left, too little for a mosaic; free some"):
            check(run, tmp_path / "m.tif")
        check(run, tmp_path / "m.tif", computed=True)
        check(run, tmp_path / "m.jpg")
        usage.free = 3_900_000
        with pytest.raises(InputError, match=r"m\.jpg: the disk has 3 MB left, too little"):
            check(run, tmp_path / "m.jpg")


def test_what_headers_forbid_is_refused_before_the_first_feature(tmp_path: Path) -> None:
    photographs = [tmp_path / f"{number}.png" for number in range(3)]
    for number, path in enumerate(photographs):
        cv2.imwrite(str(path), np.full((80, 100), 1000 * number, np.uint16))
    smaller = pytest.raises(InputError, match="smaller than a pixel; raise `scale`")
    with open_run(photographs, MosaicOptions(scale=0.009)) as run, smaller:
        check(run, tmp_path / "m.tif")
    with open_run(photographs, MosaicOptions(scale=0.011)) as run:
        check(run, tmp_path / "m.tif")
        with pytest.raises(InputError, match=r"m\.tif: JPEG holds 8 bits, the photographs have 16"):
            check(run, tmp_path / "m.tif", OutputForm(compress="jpeg"))
    # One of 8 bits makes a mosaic of 8 bits; a damaged one is judged when it is read.
    for content in (cv2.imencode(".png", np.zeros((80, 100), np.uint8))[1].tobytes(), b"damaged"):
        photographs[0].write_bytes(content)
        with open_run(photographs, MosaicOptions()) as run:
            check(run, tmp_path / "m.tif", OutputForm(compress="jpeg"))


@pytest.mark.parametrize(("folder", "groups"), [("survey", False), ("survey", True), ("survey_2", True)])
def test_tiles_replace_no_photographs(tmp_path: Path, folder: str, groups: bool) -> None:
    photographs = [tmp_path / folder / "7" / f"{number}.png" for number in range(3)]
    photographs[0].parent.mkdir(parents=True)
    for path in photographs:
        cv2.imwrite(str(path), np.zeros((80, 100), np.uint8))
    form = OutputForm(tiles=tmp_path / "survey")
    with open_run(photographs, MosaicOptions(all_groups=groups)) as run:
        with pytest.raises(InputError, match=f"{folder}: its 7 holds .*0.png, one of the inputs"):
            check(run, tmp_path / "m.tif", form, overwrite=True)
        check(run, tmp_path / "m.tif", OutputForm(tiles=tmp_path / "tiles"), overwrite=True)


def test_the_mosaics_of_further_groups_replace_no_photographs(tmp_path: Path) -> None:
    photographs = [tmp_path / f"m_{number}.png" for number in range(3)]
    for path in photographs:
        cv2.imwrite(str(path), np.zeros((80, 100), np.uint8))
    refused = pytest.raises(InputError, match=r"m_0\.png: is one of the inputs")
    with open_run(photographs, MosaicOptions(all_groups=True)) as run, refused:
        check(run, tmp_path / "m.png", overwrite=True)


@pytest.mark.parametrize("folder", [".", "..", "/"])
def test_tiles_of_several_groups_need_a_name(tmp_path: Path, folder: str) -> None:
    form = OutputForm(tiles=Path(folder))
    refused = pytest.raises(InputError, match="has no name that could be numbered")
    with open_run([np.zeros((60, 80), np.uint8)] * 3, MosaicOptions(all_groups=True)) as run, refused:
        check(run, tmp_path / "m.tif", form, overwrite=True)


@pytest.mark.parametrize(("area_px", "enough"), [(1_000_000, True), (999_999, False)])
def test_a_mosaic_of_a_megapixel_has_room(tmp_path: Path, area_px: int, enough: bool) -> None:
    with nullcontext() if enough else pytest.raises(InputError, match="full, too little for a mosaic"):
        check_room(tmp_path / "m.tif", Room(area_px, reason="full"))


@pytest.mark.parametrize(
    ("photographs", "bands", "area_px"), [(3, 3, 1000), (3, 1, 1000), (3, 5, 4000 / 6), (2, 3, Room().area_px)]
)
def test_the_room_is_that_of_the_disk_for_each_band_and_alpha(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, photographs: int, bands: int, area_px: float
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: SimpleNamespace(free=24_000))
    sources: Any = [SimpleNamespace(bands=("band",) * count) for count in (bands, *[9] * (photographs - 1))]
    assert room_of(tmp_path / "m.tif", sources, MosaicOptions()).area_px == area_px
    assert room_of(None, sources, MosaicOptions()).area_px == Room().area_px
    for path in (None, tmp_path / "m.tif"):
        limited = room_of(path, sources, MosaicOptions(canvas_limit_px=2_500_000))
        assert (limited.area_px, limited.reason) == (2_500_000, "the limit is 2.5 megapixels")


@pytest.mark.parametrize("given", ["nothing", "control_points", "positions", "repeat", "gps", "unreadable"])
def test_a_map_needs_something_that_places_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    """Each alone is enough; what cannot be read is judged when it is read."""
    photographs: list[Any] = [np.zeros((80, 100), np.uint8), tmp_path / "1.png", np.zeros((80, 100), np.uint8)]
    cv2.imwrite(str(photographs[1]), np.zeros((80, 100), np.uint8))
    position = Position(46, 7) if given == "gps" else None
    by_path = {photographs[1]: Metadata(position=position)}
    monkeypatch.setattr("skymosaic.imagery.photographs.read_metadata", lambda path: by_path[path])
    access = os.access
    monkeypatch.setattr(
        os, "access", lambda path, mode: given != "unreadable" if path == photographs[1] else access(path, mode)
    )
    changes: dict[str, Any] = {given: object()} if given in vars(MosaicOptions()) else {}
    options = replace(MosaicOptions(), **changes)
    sources = [Source(number, str(number), each) for number, each in enumerate(photographs)]
    refused = pytest.raises(
        RegistrationError, match=r"m\.tif has no place on the map: 0 of 3 photographs have GPS; .*; nothing was written"
    )
    with refused if given == "nothing" else nullcontext():
        check_outputs(tmp_path / "m.tif", OutputForm(require_map=True), sources, options)
