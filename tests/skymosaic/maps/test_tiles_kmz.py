import resource
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
import rasterio.enums
import rasterio.vrt
import rasterio.warp

from skymosaic.common.errors import InputError
from skymosaic.maps.georeference import Georeference
from skymosaic.maps.geotiff import tee_to_raster
from skymosaic.maps.tiles import write_kmz

STEP_M, TURN = 0.05, 0.3
NAME = "M.KMZ"


def raster(path: Path, size: tuple[int, int], turn: float = 0.0, east_m: float = 480_000, noise: bool = False) -> Path:
    """A picture without a photograph in its first quarter; smooth, unless it is ``noise``."""
    rng, (width, height) = np.random.default_rng(0), size
    image = rng.integers(0, 255, (height // (1 if noise else 32), width // (1 if noise else 32), 3), dtype=np.uint8)
    image, shown = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), np.ones((height, width), np.bool_)
    shown[: height // 2, : width // 2] = False
    across, down = STEP_M * np.cos(turn), STEP_M * np.sin(turn)
    to_map = np.array([[across, down, east_m], [down, -across, 5_200_000], [0, 0, 1]])
    for _ in tee_to_raster(path, size, [(np.asarray(image), shown)], Georeference("EPSG:32633", to_map, 0.5)):
        pass
    return path


# Rasterio multiplies transformations as Affine no longer wants it.
@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
@pytest.mark.parametrize("turn", [0, TURN])
@pytest.mark.parametrize("size", [(1100, 700), (130, 200)])
def test_a_kmz_shows_the_mosaic_where_it_lies(tmp_path: Path, size: tuple[int, int], turn: float) -> None:
    path = tmp_path / NAME
    write_kmz(path, raster(tmp_path / "raw.tif", size, turn))
    assert {each.name for each in tmp_path.iterdir()} == {NAME, "raw.tif"}
    with rasterio.open(path) as made, rasterio.open(tmp_path / "raw.tif") as raw:
        grid = {"crs": made.crs, "transform": made.transform, "width": made.width, "height": made.height}
        with rasterio.vrt.WarpedVRT(raw, resampling=rasterio.enums.Resampling.cubic, **grid) as same:
            expected, seen = same.read().astype(int), made.read().astype(int)
        shown = (expected[3] == 255) & (seen[3] == 255)
        # GDAL places pixels of a turned raster within an eighth of one.
        assert np.abs(expected - seen)[:3, shown].mean() < 3
        assert (expected[3] != seen[3]).mean() < 1e-3
        # Nothing is cut off: all that the raster shows is in the file.
        assert shown.sum() * abs(made.transform.determinant) == pytest.approx(
            0.75 * size[0] * size[1] * area(raw, made.crs), rel=0.01
        )
        if not turn:
            box = np.array(rasterio.warp.transform_bounds(raw.crs, made.crs, *raw.bounds))
            pixels = np.abs(np.array(made.bounds) - box) / np.abs(made.res[0])
            assert pixels.max() < 2


def area(raw: rasterio.DatasetReader, crs: str) -> float:
    """The area of a pixel in the units of another system."""
    a, b, c, d, e, f = raw.transform[:6]
    x, y = rasterio.warp.transform(raw.crs, crs, [c, c + 100 * a, c + 100 * b], [f, f + 100 * d, f + 100 * e])
    return abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) / 10_000


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    far = raster(tmp_path / "far.tif", (200, 100), east_m=499_995)
    with rasterio.open(far, "r+") as file:
        file.crs = "+proj=tmerc +lat_0=0 +lon_0=180 +k=0.9996 +x_0=500000 +datum=WGS84"
    with pytest.raises(InputError, match=rf"{NAME}: the mosaic reaches beyond Web Mercator \(across 180 degrees"):
        write_kmz(tmp_path / NAME, far)
    noise = raster(tmp_path / "raw.tif", (600, 700), noise=True)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(InputError, match=rf"{NAME}: cannot be written \(.*\); choose another folder"):
            write_kmz(tmp_path / NAME, noise)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert {each.name for each in tmp_path.iterdir()} == {"far.tif", "raw.tif"}
