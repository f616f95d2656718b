"""Multi-band sets by command, in the panel and in a live mosaic."""

import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
import rasterio.errors

from skymosaic.common.errors import InputError
from skymosaic.imagery.band_sets import group_band_sets
from skymosaic.imagery.live_frames import read_live_frames
from skymosaic.imagery.photographs import list_sources
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.panel.options import Options
from skymosaic.panel.tasks.mosaic_tasks import make_mosaic
from tests.skymosaic.flight.picture.conftest import CAPTURES
from tests.system.command_line import only_error, skymosaic

FEW = 3
"""Captures of the flight that are enough for a mosaic."""


def test_one_geotiff_shows_the_same_ground_in_all_bands(band_folder: Path, tmp_path: Path) -> None:
    made = skymosaic("mosaic", band_folder, "-o", "m.tif", "--band", "RED", "--report", "report", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert "bands: green, red, nir; registered by red" in made.stdout
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        file = rasterio.open(tmp_path / "m.tif")
    with file:
        assert file.descriptions[:3] == ("green", "red", "nir")
        assert file.dtypes == ("uint16",) * 4
        *bands, alpha = file.read()
    shown = alpha == 65_535
    assert shown.mean() > 0.85
    assert all((band > 0).sum() == shown.sum() for band in bands)
    # The rendered near infrared falls as green rises, so fine detail agrees only where both lie on each other.
    inside = cv2.erode(shown.astype(np.uint8), np.ones((15, 15))) > 0
    fine = [band - cv2.GaussianBlur(band, (0, 0), 4) for band in (plane.astype(np.float32) for plane in bands)]
    assert np.corrcoef(fine[0][inside], fine[2][inside])[0, 1] < -0.985


def test_the_panel_writes_all_bands_of_uploaded_sets(band_folder: Path, tmp_path: Path) -> None:
    run = shutil.copytree(band_folder, tmp_path / "run")
    (tmp_path / "pictures").mkdir()
    names = sorted(path.name for path in run.iterdir())[: 3 * FEW]
    result = make_mosaic(run, names, Options.of_preset("aerial"), tmp_path / "pictures", progress=lambda *_: None)
    assert result.facts["photographs placed"] == f"{FEW} of {FEW}"
    assert result.facts["bands"].startswith("green, red, nir; registered by green")
    assert result.command.split()[2 : 2 + len(names)] == names
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning), rasterio.open(run / "mosaic.tif") as file:
        assert file.descriptions[:3] == ("green", "red", "nir")


def test_a_live_mosaic_shows_one_named_band(band_folder: Path) -> None:
    def shown(band: str | None, source: str = str(band_folder)) -> list[str]:
        frames = read_live_frames(source, idle_seconds=1.0, tell=lambda _line: None, band=band)
        return [Path(frame.photograph.name).name for frame in frames]

    assert shown("nir") == [f"IMG_{number:04}_NIR.TIF" for number in range(CAPTURES)]
    with pytest.raises(InputError, match=r"multi-band sets \(green, red, nir\); name the band to show: `band` green"):
        shown(None)
    with pytest.raises(InputError, match="`band` thermal: valid: blue, green"):
        shown("thermal")
    with pytest.raises(InputError, match="only a folder can hold multi-band sets"):
        shown("nir", "0")


def test_a_damaged_band_leaves_out_its_capture(band_folder: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(band_folder, tmp_path / "bands")
    path = folder / "IMG_0004_NIR.TIF"
    cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED), [cv2.IMWRITE_TIFF_COMPRESSION, 8])
    data = bytearray(path.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 400] = bytes(400)
    path.write_bytes(data)
    made = skymosaic("mosaic", folder, "-o", "m.tif", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert re.search(r"left out: .*IMG_0004_NIR\.TIF: the TIFF is damaged \(", made.stderr)
    assert f"{CAPTURES - 1} photographs of {CAPTURES}" in made.stdout


def test_bands_need_a_tif_are_kept_if_damaged_and_shown(band_folder: Path, tmp_path: Path) -> None:
    refused = skymosaic("mosaic", band_folder, "-o", "m.png", cwd=tmp_path)
    assert "m.png: a mosaic of 3 bands must be a .tif" in only_error(refused.stderr)
    capture = group_band_sets(list_sources([band_folder]))[0].with_damaged(keep=True)
    assert [source.keep_damaged for source in (capture, *capture.bands.values())] == [True] * 4
    few = sorted(band_folder.iterdir())[: 3 * FEW]
    with open_run(few, MosaicOptions(band="red")) as run:
        made = next(run.mosaics())
    assert "<img" in made._repr_html_()
    assert not made.layout.meshes  # the other bands would not be bent
