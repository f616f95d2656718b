"""What is refused before the work begins."""

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.flight.picture.output import PLAIN, OutputForm
from skymosaic.mosaicking.api import open_plan
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.mosaicking.outputs import check_outputs
from skymosaic.mosaicking.plan import MosaicPlan


def check(plan: MosaicPlan, output: Path, form: OutputForm = PLAIN, **limits: Any) -> None:
    check_outputs(output, form, plan.sources, plan.options, **limits)


def test_a_full_disk_is_refused_before_the_first_feature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage: Any = SimpleNamespace(free=20_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage)
    photographs = [np.zeros((60, 80), np.uint8)] * 3
    with open_plan(photographs, MosaicOptions()) as plan:
        with pytest.raises(InputError, match=r"m\.tif: the disk has 19 MB left, too little for a mosaic; free some"):
            check(plan, tmp_path / "m.tif")
        check(plan, tmp_path / "m.tif", computed=True)
        check(plan, tmp_path / "m.jpg")
        usage.free = 3_900_000
        with pytest.raises(InputError, match=r"m\.jpg: the disk has 3 MB left, too little"):
            check(plan, tmp_path / "m.jpg")


def test_what_headers_forbid_is_refused_before_the_first_feature(tmp_path: Path) -> None:
    photographs = [tmp_path / f"{number}.png" for number in range(3)]
    for number, path in enumerate(photographs):
        cv2.imwrite(str(path), np.full((80, 100), 1000 * number, np.uint16))
    smaller = pytest.raises(InputError, match="smaller than a pixel; raise `scale`")
    with open_plan(photographs, MosaicOptions(scale=0.009)) as plan, smaller:
        check(plan, tmp_path / "m.tif")
    with open_plan(photographs, MosaicOptions(scale=0.011)) as plan:
        check(plan, tmp_path / "m.tif")
        with pytest.raises(InputError, match=r"m\.tif: JPEG holds 8 bits, the photographs have 16"):
            check(plan, tmp_path / "m.tif", OutputForm(compress="jpeg"))
    # One of 8 bits makes a mosaic of 8 bits; a damaged one is judged when it is read.
    for content in (cv2.imencode(".png", np.zeros((80, 100), np.uint8))[1].tobytes(), b"damaged"):
        photographs[0].write_bytes(content)
        with open_plan(photographs, MosaicOptions()) as plan:
            check(plan, tmp_path / "m.tif", OutputForm(compress="jpeg"))


@pytest.mark.parametrize(("folder", "groups"), [("survey", False), ("survey", True), ("survey_2", True)])
def test_tiles_replace_no_photographs(tmp_path: Path, folder: str, groups: bool) -> None:
    photographs = [tmp_path / folder / "7" / f"{number}.png" for number in range(3)]
    photographs[0].parent.mkdir(parents=True)
    for path in photographs:
        cv2.imwrite(str(path), np.zeros((80, 100), np.uint8))
    form = OutputForm(tiles=tmp_path / "survey")
    with open_plan(photographs, MosaicOptions(all_groups=groups)) as plan:
        with pytest.raises(InputError, match=f"{folder}: its 7 holds .*0.png, one of the inputs"):
            check(plan, tmp_path / "m.tif", form, overwrite=True)
        check(plan, tmp_path / "m.tif", OutputForm(tiles=tmp_path / "tiles"), overwrite=True)


def test_the_mosaics_of_further_groups_replace_no_photographs(tmp_path: Path) -> None:
    photographs = [tmp_path / f"m_{number}.png" for number in range(3)]
    for path in photographs:
        cv2.imwrite(str(path), np.zeros((80, 100), np.uint8))
    refused = pytest.raises(InputError, match=r"m_0\.png: is one of the inputs")
    with open_plan(photographs, MosaicOptions(all_groups=True)) as plan, refused:
        check(plan, tmp_path / "m.png", overwrite=True)


@pytest.mark.parametrize("folder", [".", "..", "/"])
def test_tiles_of_several_groups_need_a_name(tmp_path: Path, folder: str) -> None:
    form = OutputForm(tiles=Path(folder))
    refused = pytest.raises(InputError, match="has no name that could be numbered")
    with open_plan([np.zeros((60, 80), np.uint8)] * 3, MosaicOptions(all_groups=True)) as plan, refused:
        check(plan, tmp_path / "m.tif", form, overwrite=True)
