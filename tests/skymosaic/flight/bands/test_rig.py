import shutil
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest

from skymosaic.common.errors import RegistrationError
from skymosaic.flight.bands.rig import Alignment, align_bands
from skymosaic.geometry.homography import apply
from skymosaic.imagery.band_sets import group_band_sets
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import list_sources
from skymosaic.running.workers import Workers
from tests.skymosaic.flight.bands.conftest import CAPTURES, SIZE, homography

GRID = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 5), np.linspace(0, SIZE[1] - 1, 5)), -1).reshape(-1, 2)


def aligned(folder: Path, band: str = "green") -> Mapping[str, Alignment]:
    with Workers() as workers:
        return align_bands(group_band_sets(list_sources([folder]), band), band, Lens(), workers)


def test_the_alignment_of_the_rig_is_found(band_folder: Path) -> None:
    alignments = aligned(band_folder)
    for band, name in (("RED", "red"), ("NIR", "nir")):
        error_px = np.linalg.norm(apply(alignments[name].homography, GRID) - apply(homography(band), GRID), axis=1)
        assert error_px.mean() < 0.15


def test_cameras_that_move_are_refused(band_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(band_folder, tmp_path / "loose")
    path = tmp_path / "loose" / "IMG_0002_NIR.TIF"
    cv2.imwrite(str(path), np.roll(np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)), 3, axis=1))
    with pytest.raises(RegistrationError, match=r"band nir cannot be aligned with band green: .* in one capture"):
        aligned(tmp_path / "loose")


def test_bands_of_other_ground_are_refused(band_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(band_folder, tmp_path / "other")
    for number in range(CAPTURES):
        path = tmp_path / "other" / f"IMG_{number:04}_RED.TIF"
        cv2.imwrite(str(path), np.random.default_rng(number).integers(0, 60_000, SIZE[::-1], dtype=np.uint16))
    with pytest.raises(RegistrationError, match="band red cannot be aligned"):
        aligned(tmp_path / "other")
