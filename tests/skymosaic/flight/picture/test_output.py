import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.compositing.warp import CANVAS_LIMIT_PX, Canvas
from skymosaic.flight.picture.composition import Room
from skymosaic.flight.picture.output import OutputForm, room_for
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions


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


def test_a_canvas_that_just_fits_is_not_reduced() -> None:
    room = Room(area_px=1e6, side_px=1000)
    assert room.share_of(Canvas(0, 0, 1000, 1000)) == 1
    assert 0.99 < room.share_of(Canvas(0, 0, 1001, 999)) < 0.9991


def test_a_full_disk_is_refused_before_the_first_feature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leave_free(monkeypatch, 20_000_000)
    photographs = [np.zeros((60, 80), np.uint8)] * 3
    with open_plan(photographs, MosaicOptions()) as plan:
        with pytest.raises(InputError, match=r"m\.tif: the disk has 19 MB left, too little for a mosaic; free some"):
            plan.check_outputs(tmp_path / "m.tif")
        plan.check_outputs(tmp_path / "m.jpg")


def test_what_headers_forbid_is_refused_before_the_first_feature(tmp_path: Path) -> None:
    photographs = [tmp_path / f"{number}.png" for number in range(3)]
    for number, path in enumerate(photographs):
        cv2.imwrite(str(path), np.full((80, 100), 1000 * number, np.uint16))
    smaller = pytest.raises(InputError, match="smaller than a pixel; raise --scale")
    with open_plan(photographs, MosaicOptions(scale=0.009)) as plan, smaller:
        plan.check_outputs(tmp_path / "m.tif")
    with open_plan(photographs, MosaicOptions(scale=0.011)) as plan:
        plan.check_outputs(tmp_path / "m.tif")
        with pytest.raises(InputError, match=r"m\.tif: JPEG holds 8 bits, the photographs have 16"):
            plan.check_outputs(tmp_path / "m.tif", OutputForm(compress="jpeg"))
    # One of 8 bits makes a mosaic of 8 bits; a damaged one is judged when it is read.
    for content in (cv2.imencode(".png", np.zeros((80, 100), np.uint8))[1].tobytes(), b"damaged"):
        photographs[0].write_bytes(content)
        with open_plan(photographs, MosaicOptions()) as plan:
            plan.check_outputs(tmp_path / "m.tif", OutputForm(compress="jpeg"))


@pytest.mark.parametrize(("folder", "groups"), [("survey", False), ("survey", True), ("survey_2", True)])
def test_tiles_replace_no_photographs(tmp_path: Path, folder: str, groups: bool) -> None:
    photographs = [tmp_path / folder / "7" / f"{number}.png" for number in range(3)]
    photographs[0].parent.mkdir(parents=True)
    for path in photographs:
        cv2.imwrite(str(path), np.zeros((80, 100), np.uint8))
    form = OutputForm(tiles=tmp_path / "survey")
    with open_plan(photographs, MosaicOptions(all_groups=groups)) as plan:
        with pytest.raises(InputError, match=f"{folder}: its 7 holds .*0.png, one of the inputs"):
            plan.check_outputs(tmp_path / "m.tif", form, overwrite=True)
        plan.check_outputs(tmp_path / "m.tif", OutputForm(tiles=tmp_path / "tiles"), overwrite=True)


def test_the_mosaics_of_further_groups_replace_no_photographs(tmp_path: Path) -> None:
    photographs = [tmp_path / f"m_{number}.png" for number in range(3)]
    for path in photographs:
        cv2.imwrite(str(path), np.zeros((80, 100), np.uint8))
    refused = pytest.raises(InputError, match=r"m_0\.png: is one of the inputs")
    with open_plan(photographs, MosaicOptions(all_groups=True)) as plan, refused:
        plan.check_outputs(tmp_path / "m.png", overwrite=True)


@pytest.mark.parametrize("folder", [".", "..", "/"])
def test_tiles_of_several_groups_need_a_name(tmp_path: Path, folder: str) -> None:
    form = OutputForm(tiles=Path(folder))
    refused = pytest.raises(InputError, match="has no name that could be numbered")
    with open_plan([np.zeros((60, 80), np.uint8)] * 3, MosaicOptions(all_groups=True)) as plan, refused:
        plan.check_outputs(tmp_path / "m.tif", form, overwrite=True)
