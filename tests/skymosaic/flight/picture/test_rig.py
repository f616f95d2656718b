import shutil
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest

from skymosaic.common.errors import RegistrationError
from skymosaic.flight.picture.rig import Alignment, _fit, align_bands
from skymosaic.geometry.homography import apply
from skymosaic.imagery.band_sets import group_band_sets
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import list_sources
from skymosaic.running.workers import Workers
from tests.skymosaic.flight.picture.conftest import CAPTURES, SIZE, homography

GRID = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 5), np.linspace(0, SIZE[1] - 1, 5)), -1).reshape(-1, 2)


def aligned(folder: Path, band: str = "green") -> Mapping[str, Alignment]:
    with Workers() as workers:
        return align_bands(group_band_sets(list_sources([folder]), band), band, Lens(), workers)


def test_the_alignment_of_the_rig_is_found(band_folder: Path) -> None:
    alignments = aligned(band_folder)
    for band, name in (("RED", "red"), ("NIR", "nir")):
        error_px = np.linalg.norm(apply(alignments[name].homography, GRID) - apply(homography(band), GRID), axis=1)
        assert error_px.mean() < 0.15


@pytest.mark.parametrize(
    ("captures", "says"),
    [
        ([(20, 0), (20, 0)], ""),
        ([(20, 0), (19, 0)], "39 of 39 places in 2 captures agree"),
        ([(26, 24), (26, 24)], ""),
        ([(20, 31), (20, 31)], "40 of 102 places in 2 captures agree"),
        ([(9, 0)] * 5, "none of 5 captures shows 10 places in both"),
        ([(10, 0), *[(9, 0)] * 4], ""),
        ([(40, 0), (15, 0, 4)], r"it lies [34]\.\d px off in one capture; the cameras of a rig must be fixed"),
        ([(40, 0), (15, 0, 0.5)], ""),
        ([(40, 0), (9, 0, 4)], ""),
    ],
)  # fmt: skip
def test_a_rig_is_fixed_if_enough_places_of_each_capture_agree(captures: list[tuple[float, ...]], says: str) -> None:
    rng, places = np.random.default_rng(0), []
    for true, false, *off in captures:
        here = rng.uniform(0, 600, (int(true + false), 2))
        there = here + np.array([7 + sum(off), -3])
        there[int(true) :] = rng.uniform(0, 600, (int(false), 2))
        places.append((here, there, np.ones(len(here))))
    twice = np.diag([2.0, 2.0, 1.0])
    if says:
        with pytest.raises(RegistrationError, match=f"^band red cannot be aligned with band green: {says}"):
            _fit("red", "green", places, twice)
        return
    found = _fit("red", "green", places, twice)
    np.testing.assert_allclose(apply(found.homography, GRID), GRID - [14, -6], atol=0.5)
    assert found.error_px < 2
    # The median of an exact capture and of one that is half a pixel off; the photographs are twice as large.
    assert (0.3 < found.error_px < 0.5) is (captures[-1] == (15, 0, 0.5))


def test_cameras_that_move_and_other_ground_are_refused(band_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(band_folder, tmp_path / "loose")
    path = tmp_path / "loose" / "IMG_0002_NIR.TIF"
    cv2.imwrite(str(path), np.roll(np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)), 3, axis=1))
    with pytest.raises(RegistrationError, match=r"band nir cannot be aligned with band green: .* in one capture"):
        aligned(tmp_path / "loose")
    shutil.copytree(band_folder, tmp_path / "other")
    for number in range(CAPTURES):
        path = tmp_path / "other" / f"IMG_{number:04}_RED.TIF"
        cv2.imwrite(str(path), np.random.default_rng(number).integers(0, 60_000, SIZE[::-1], dtype=np.uint16))
    with pytest.raises(RegistrationError, match="band red cannot be aligned"):
        aligned(tmp_path / "other")
