import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio
import rasterio.enums
import rasterio.errors
from numpy.typing import NDArray

from skymosaic.common.errors import InputError
from skymosaic.maps.georeference import Georeference
from skymosaic.maps.geotiff import tee_to_raster, write_cog
from tests.made import leave_free, limited_files

cogeo = pytest.importorskip("rio_cogeo.cogeo")
PLACE = Georeference("EPSG:32615", np.array([[0.1, 0, 430_000], [0, -0.1, 5_190_000], [0, 0, 1]]), 0.5)


def picture(*channels: int, kind: type = np.uint8) -> np.ndarray:
    noise: np.ndarray = np.random.default_rng(0).integers(1, np.iinfo(kind).max, (700, 600, *channels), dtype=kind)
    return cv2.GaussianBlur(noise, (0, 0), 3)


def written(path: Path, image: np.ndarray, place: Georeference | None = PLACE, compress: str = "deflate") -> np.ndarray:
    """Write a picture in two bands; returns what it shows."""
    shown = np.ones(image.shape[:2], np.uint16)
    shown[100:200] = 0
    bands = [(image[rows], shown[rows]) for rows in (slice(512), slice(512, 700))]
    for (passed, _), (given, _) in zip(
        tee_to_raster(path.with_name("raw.tif"), (600, 700), bands, place), bands, strict=True
    ):
        assert passed is given
    write_cog(path, path.with_name("raw.tif"), compress)
    assert {each.name for each in path.parent.iterdir()} == {path.name, "raw.tif"}
    return shown


def test_memory_does_not_grow_with_the_picture(tmp_path: Path) -> None:
    """GDAL's own cache would hold all 288 MB of this one, on a machine of 6 GB or more."""
    program = (
        "import re, sys\nfrom pathlib import Path\nimport numpy as np\n"
        "from skymosaic.maps.geotiff import tee_to_raster\n"
        # What `resource` reports begins with the peak of the process that started this one.
        "peak_kb = lambda: int(re.search(r'VmHWM:\\s+(\\d+)', Path('/proc/self/status').read_text())[1])\n"
        "bands = [(np.ones((250, 12000, 3), np.uint8), np.ones((250, 12000), np.bool_))] * 24\n"
        "before_kb = peak_kb()\n"
        "for _ in tee_to_raster(Path(sys.argv[1]), (12000, 6000), bands, None):\n    pass\n"
        "print((peak_kb() - before_kb) // 1024)"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "raw.tif")]
    growth_mb = int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert growth_mb < 150


@pytest.mark.parametrize("image", [picture(3), picture(), picture(kind=np.uint16)], ids=["bgr", "gray", "16 bit"])
def test_a_geotiff_is_valid_and_says_where_it_lies_and_what_it_shows(tmp_path: Path, image: NDArray[Any]) -> None:
    shown = written(tmp_path / "map.tif", image)
    valid, errors, _ = cogeo.cog_validate(tmp_path / "map.tif", strict=True)
    assert (valid, errors) == (True, [])
    with rasterio.open(tmp_path / "map.tif") as file:
        assert file.crs.to_epsg() == 32615
        # Rasterio gives the middle of the first pixel.
        np.testing.assert_allclose(file.xy(0, 0), (430_000, 5_190_000), atol=2e-3)
        assert file.nodata is None
        assert file.colorinterp[-1] == rasterio.enums.ColorInterp.alpha
        usual = rasterio.enums.ColorInterp.red if image.ndim == 3 else rasterio.enums.ColorInterp.gray
        assert file.colorinterp[0] == usual
        assert file.tags(ns="IMAGE_STRUCTURE")["PREDICTOR"] == "2"
        *planes, alpha = file.read()
        np.testing.assert_array_equal(np.stack(planes[::-1], axis=-1), np.atleast_3d(image))
        np.testing.assert_array_equal(alpha, shown * np.iinfo(image.dtype).max)


def test_bands_keep_their_order_and_their_names(tmp_path: Path) -> None:
    image, shown = picture(3, kind=np.uint16), np.ones((700, 600), np.uint16)
    for _ in tee_to_raster(tmp_path / "raw.tif", (600, 700), [(image, shown)], PLACE, ("green", "red", "nir")):
        pass
    with rasterio.open(tmp_path / "raw.tif") as file:
        assert file.descriptions == ("green", "red", "nir", None)
        assert file.colorinterp[0] == rasterio.enums.ColorInterp.gray
        np.testing.assert_array_equal(file.read([1, 2, 3]).transpose(1, 2, 0), image)


def test_jpeg_is_smaller_and_keeps_the_mask(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    image = picture(3)
    shown = written(tmp_path / "a" / "map.tif", image, compress="jpeg")
    written(tmp_path / "b" / "map.tif", image)
    assert 2 * (tmp_path / "a" / "map.tif").stat().st_size < (tmp_path / "b" / "map.tif").stat().st_size
    with rasterio.open(tmp_path / "a" / "map.tif") as file:
        np.testing.assert_array_equal(file.dataset_mask() > 0, shown)
        assert np.abs(file.read([3, 2, 1]).transpose(1, 2, 0)[shown > 0].astype(int) - image[shown > 0]).mean() < 6


def test_a_picture_without_a_place_has_overviews_too(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    written(tmp_path / "plain.tif", picture(3), None)
    assert not recwarn.list
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        file = rasterio.open(tmp_path / "plain.tif")
    with file:
        assert file.overviews(1)
        assert file.crs is None


def test_a_full_disk_is_named_with_the_mosaic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image, shown = picture(3), np.ones((700, 600), np.uint16)
    raster = tmp_path / "raw.tif"
    list(tee_to_raster(raster, (600, 700), [(image, shown)], PLACE))
    leave_free(monkeypatch, 0)
    line = r"map\.tif: cannot be written \(No space left on device\); choose another folder"
    with limited_files(100_000), pytest.raises(InputError, match=line):
        list(tee_to_raster(tmp_path / "other.tif", (600, 700), [(image, shown)], PLACE, mosaic=tmp_path / "map.tif"))
    with limited_files(100_000), pytest.raises(InputError, match=line):
        write_cog(tmp_path / "map.tif", raster)
    assert not (tmp_path / "map.tif").exists()
