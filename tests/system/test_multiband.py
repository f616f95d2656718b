"""A rendered flight of three bands, whose cameras are turned and shifted against each other by known homographies."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.scene import make_lawnmower
from skymosaic.errors import InputError, RegistrationError
from skymosaic.flight.bands.rig import align_bands
from skymosaic.flight.workers import Workers
from skymosaic.geometry.homography import apply
from skymosaic.imagery.band_sets import group_band_sets
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.live_frames import read_live_frames
from skymosaic.imagery.photographs import list_sources
from skymosaic.panel.options import Options
from skymosaic.panel.tasks.mosaic_tasks import make_mosaic
from tests.system.command_line import only_error, skymosaic

CAPTURES, SIZE, MARGIN_PX = 5, (400, 300), 24
WHOLE = (SIZE[0] + 2 * MARGIN_PX, SIZE[1] + 2 * MARGIN_PX)
INTO_FRAME = np.array([[1, 0, -MARGIN_PX], [0, 1, -MARGIN_PX], [0, 0, 1.0]])
RIG = {"RED": (7.3, -4.6, 0.6), "NIR": (-9.2, 5.1, -0.8)}
"""Pixels to the right, pixels down, degrees."""
GRID = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 5), np.linspace(0, SIZE[1] - 1, 5)), -1).reshape(-1, 2)


def homography(band: str) -> np.ndarray:
    """Pixels of a band to those of the green one."""
    if band not in RIG:
        return np.eye(3)
    x, y, degrees = RIG[band]
    turn = cv2.getRotationMatrix2D(((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2), degrees, 1.0)
    turn[:, 2] += x, y
    return np.vstack([turn, [2e-6, -1e-6, 1]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """16 bits; what is dark in green is bright in near infrared, where each capture has an exposure of its own."""
    folder = tmp_path_factory.mktemp("bands")
    rng = np.random.default_rng(0)
    for number, image in enumerate(make_lawnmower(5, CAPTURES, WHOLE, forward_overlap=0.7, side_overlap=0.6).images):
        green, red = (cv2.GaussianBlur(image[..., k].astype(np.float32), (0, 0), 0.7) for k in (1, 2))
        shown = {"GRE": 4000 + 120 * green, "RED": 3000 + 90 * red, "NIR": (1 + 0.1 * number) * (45_000 - 150 * green)}
        for band, values in shown.items():
            matrix = np.linalg.inv(homography(band)) @ INTO_FRAME
            seen = cv2.warpPerspective(values, matrix, SIZE, flags=cv2.INTER_CUBIC)
            noisy = np.clip(seen + rng.normal(0, 60, seen.shape), 0, 65_535)
            cv2.imwrite(str(folder / f"IMG_{number:04}_{band}.TIF"), noisy.astype(np.uint16))
    return folder


def aligned(folder: Path, band: str = "green"):
    with Workers() as workers:
        return align_bands(group_band_sets(list_sources([folder]), band), band, Lens(), workers)


def test_the_alignment_of_the_rig_is_found(folder):
    found = aligned(folder)
    for band, name in (("RED", "red"), ("NIR", "nir")):
        error_px = np.linalg.norm(apply(found[name].homography, GRID) - apply(homography(band), GRID), axis=1)
        assert error_px.mean() < 0.15


def test_cameras_that_move_are_refused(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "loose")
    path = tmp_path / "loose" / "IMG_0002_NIR.TIF"
    cv2.imwrite(str(path), np.roll(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), 3, axis=1))
    with pytest.raises(RegistrationError, match=r"band nir cannot be aligned with band green: .* in one capture"):
        aligned(tmp_path / "loose")


def test_bands_of_other_ground_are_refused(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "other")
    for number in range(CAPTURES):
        path = tmp_path / "other" / f"IMG_{number:04}_RED.TIF"
        cv2.imwrite(str(path), np.random.default_rng(number).integers(0, 60_000, SIZE[::-1], dtype=np.uint16))
    with pytest.raises(RegistrationError, match="band red cannot be aligned"):
        aligned(tmp_path / "other")


def test_one_geotiff_shows_the_same_ground_in_all_bands(folder, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    made = skymosaic("mosaic", folder, "-o", "m.tif", "--band", "RED", "--report", "report", cwd=tmp_path)
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


def test_the_panel_writes_all_bands_of_uploaded_sets(folder, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    run = shutil.copytree(folder, tmp_path / "run")
    (tmp_path / "pictures").mkdir()
    names = sorted(path.name for path in run.iterdir())
    result = make_mosaic(run, names, Options.of_preset("aerial"), tmp_path / "pictures", progress=lambda *_: None)
    assert result.facts["photographs placed"] == f"{CAPTURES} of {CAPTURES}"
    assert result.facts["bands"].startswith("green, red, nir; registered by green")
    assert result.command.split()[2 : 2 + len(names)] == names
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning), rasterio.open(run / "mosaic.tif") as file:
        assert file.descriptions[:3] == ("green", "red", "nir")


def test_a_live_mosaic_shows_one_named_band(folder):
    def shown(band: str | None, source: str = str(folder)) -> list[str]:
        return [
            Path(p.name).name for p in read_live_frames(source, idle_seconds=0.1, tell=lambda _line: None, band=band)
        ]

    assert shown("nir") == [f"IMG_{number:04}_NIR.TIF" for number in range(CAPTURES)]
    with pytest.raises(InputError, match=r"multi-band sets \(green, red, nir\); name the band to show: --band green"):
        shown(None)
    with pytest.raises(InputError, match="band thermal: valid: blue, green"):
        shown("thermal")
    with pytest.raises(InputError, match="only a folder can hold multi-band sets"):
        shown("nir", "0")


@pytest.mark.parametrize(
    ("change", "arguments", "message"),
    [
        (lambda folder: (folder / "IMG_0003_NIR.TIF").unlink(), {}, "IMG_0003: band nir is missing"),
        (lambda folder: cut(folder / "IMG_0001_RED.TIF"), {}, "RED.TIF: 400x200 pixels, but band green has 400x300"),
        (lambda folder: shutil.copy(folder / "IMG_0001_RED.TIF", folder / "a.tif"), {}, "a.tif: belongs to no"),
        (lambda _: None, {"band": "thermal"}, "band thermal: the sets have green, red, nir"),
    ],
)
def test_incomplete_sets_are_refused(folder, tmp_path, change, arguments, message):
    shutil.copytree(folder, tmp_path / "sets")
    change(tmp_path / "sets")
    with pytest.raises(InputError, match=message):
        group_band_sets(list_sources([tmp_path / "sets"]), **arguments)


def cut(path: Path) -> None:
    """Remove the lower third of a picture."""
    cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[:200])


def test_bands_need_a_tif(folder, tmp_path):
    refused = skymosaic("mosaic", folder, "-o", "m.png", cwd=tmp_path)
    assert "m.png: a mosaic of 3 bands must be a .tif" in only_error(refused.stderr)


def test_damaged_bands_are_kept_where_that_is_wanted(folder):
    capture = group_band_sets(list_sources([folder]))[0].with_damaged(keep=True)
    assert [source.keep_damaged for source in (capture, *capture.bands.values())] == [True] * 4


def test_names_tell_the_bands(tmp_path):
    def bands(*names: str) -> list[list[str]]:
        folder = tmp_path / names[0]
        folder.mkdir()
        for name in names:
            cv2.imwrite(str(folder / name), np.zeros((80, 80), np.uint16))
        return [[Path(source.name).name, *source.bands] for source in group_band_sets(list_sources([folder]))]

    numbered = [f"IMG_00{number}_{band}.tif" for number in (10, 11, 12) for band in (1, 2, 10)]
    assert bands(*numbered) == [[f"IMG_00{number}_2.tif", "1", "2", "10"] for number in (10, 11, 12)]
    dji = [f"DJI_2_000{n}_{end}" for n in (1, 2, 3) for end in ("D.JPG", "MS_G.TIF", "MS_NIR.TIF", "MS_R.TIF")]
    assert bands(*dji) == [[f"DJI_2_000{n}_MS_G.TIF", "green", "red", "nir"] for n in (1, 2, 3)]
    photographs = ["a_1.tif", "b_2.tif", "c_NIR.tif", "d_NIR.tif", "e_NIR.tif"]
    assert bands(*photographs) == [[name] for name in photographs]
