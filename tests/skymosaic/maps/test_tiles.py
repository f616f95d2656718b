import contextlib
import json
import re
import sqlite3
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
import rasterio.enums
import rasterio.vrt
import rasterio.warp

from skymosaic.common.errors import InputError
from skymosaic.imagery.exif import Position
from skymosaic.maps.georeference import Georeference, map_to_globe, project_to_utm
from skymosaic.maps.geotiff import tee_to_raster
from skymosaic.maps.tiles import TILE_PX, Pyramid, write_kmz, write_mbtiles, write_tiles
from tests.made import limited_files

WIDTH, HEIGHT, METRES = 900, 700, 0.1
PLACE = Georeference("EPSG:32615", np.array([[METRES, 0, 430_000], [0, -METRES, 5_190_000], [0, 0, 1]]), 0.5)
SPOT = (640, 210)


@pytest.mark.parametrize(
    ("first", "last", "top"),
    [((3, 4), (3, 4), 5), ((2, 4), (3, 4), 4), ((3, 4), (4, 4), 2), ((3, 4), (3, 5), 4), ((15, 0), (16, 0), 0)],
)
def test_one_tile_at_the_top_shows_everything(first: tuple[int, int], last: tuple[int, int], top: int) -> None:
    assert Pyramid(True, 5, first, last).top == top


@pytest.mark.parametrize(
    ("size", "last", "tiles"),
    [
        ((256, 256), (0, 0), [1]),
        ((257, 256), (1, 0), [1, 2]),
        ((256, 257), (0, 1), [1, 2]),
        ((512, 1025), (1, 4), [1, 2, 3, 10]),
    ],
)
def test_a_mosaic_has_no_more_tiles_than_its_sides_need(
    tmp_path: Path, size: tuple[int, int], last: tuple[int, int], tiles: list[int]
) -> None:
    gray, shown = np.full(size[::-1], 90, np.uint8), np.ones(size[::-1], np.bool_)
    for _ in tee_to_raster(tmp_path / "m.tif", size, [(gray, shown)], None):
        pass
    pyramid = write_tiles(tmp_path / "tiles", tmp_path / "m.tif", "m", None)
    assert (pyramid.zoom, pyramid.last) == (len(tiles) - 1, last)
    written = [list((tmp_path / "tiles" / str(zoom)).rglob("*.webp")) for zoom in range(len(tiles))]
    assert [len(each) for each in written] == tiles
    np.testing.assert_allclose(np.asarray(cv2.imread(str(written[0][0])))[0, 0], 90, atol=2)


def test_tiles_are_no_finer_than_nine_millimetres(tmp_path: Path) -> None:
    fine = replace(PLACE, to_map=np.array([[1e-3, 0, 430_000], [0, -1e-3, 5_190_000], [0, 0, 1]]))
    assert write_tiles(tmp_path / "tiles", raster(tmp_path / "m.tif", fine), "fine", None).zoom == 24


def raster(path: Path, place: Georeference | None) -> Path:
    """A gray mosaic with a red spot, without a photograph on the left."""
    picture = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    cv2.circle(picture, SPOT, 12, (0, 0, 255), -1)
    shown = np.ones((HEIGHT, WIDTH), np.uint16)
    shown[:, :100] = 0
    for _ in tee_to_raster(path, (WIDTH, HEIGHT), [(picture, shown)], place):
        pass
    return path


def red(tile: np.ndarray) -> np.ndarray:
    """The middle of what is red in a tile, px."""
    return np.argwhere(tile[..., 2].astype(int) - tile[..., 0] > 100).mean(axis=0)[::-1]


def test_tiles_lie_where_web_mercator_puts_them(tmp_path: Path) -> None:
    pyramid = write_tiles(tmp_path, raster(tmp_path / "m.tif", PLACE), "a & b", None)
    longitude, latitude = np.radians(map_to_globe(np.array([[430_000 + 64.0, 5_190_000 - 21.0]]), "EPSG:32615")[0])
    world = np.array([longitude / np.pi + 1, 1 - np.arcsinh(np.tan(latitude)) / np.pi]) / 2
    for zoom in (pyramid.zoom, pyramid.zoom - 1):
        column, row = np.floor(world * 2**zoom).astype(int)
        tile = np.asarray(cv2.imread(str(tmp_path / str(zoom) / str(column) / f"{row}.webp"), cv2.IMREAD_UNCHANGED))
        np.testing.assert_allclose(red(tile), (world * 2**zoom % 1) * TILE_PX, atol=2)
    assert len(list((tmp_path / str(pyramid.top)).rglob("*.webp"))) == 1


# Rasterio computes the bounds of a turned raster with an operator that affine is about to drop.
@pytest.mark.filterwarnings("ignore:Use `@` matmul:PendingDeprecationWarning")
def test_a_turned_mosaic_has_the_zoom_of_its_pixels(tmp_path: Path) -> None:
    zooms = []
    for turn in (0, np.pi / 4):
        across_m, down_m = 1.2 * METRES * np.cos(turn), 1.2 * METRES * np.sin(turn)
        to_map = np.array([[across_m, down_m, 430_000], [down_m, -across_m, 5_190_000], [0, 0, 1]])
        pyramid = write_tiles(tmp_path, raster(tmp_path / "m.tif", replace(PLACE, to_map=to_map)), "turned", None)
        zooms.append(pyramid.zoom)
    assert zooms == [20, 20]


@pytest.mark.parametrize(("longitude_deg", "latitude_deg"), [(179.9998, -16.8), (12.0, -86.0)])
def test_a_mosaic_beyond_web_mercator_is_refused(tmp_path: Path, longitude_deg: float, latitude_deg: float) -> None:
    crs, ((x, y),) = project_to_utm([Position(latitude_deg, longitude_deg)])
    place = Georeference(crs, np.array([[METRES, 0, x], [0, -METRES, y], [0, 0, 1]]), 0.5)
    with pytest.raises(InputError, match="tiles: the mosaic reaches beyond Web Mercator"):
        write_tiles(tmp_path / "tiles", raster(tmp_path / "m.tif", place), "far", None)
    assert not (tmp_path / "tiles").exists()


def test_a_mosaic_without_a_place_has_tiles_of_its_own_pixels(tmp_path: Path) -> None:
    pyramid = write_tiles(tmp_path, raster(tmp_path / "m.tif", None), "plain", None)
    assert (pyramid.zoom, pyramid.top, pyramid.last) == (2, 0, (3, 2))
    tile = np.asarray(cv2.imread(str(tmp_path / "2" / str(SPOT[0] // TILE_PX) / f"{SPOT[1] // TILE_PX}.webp")))
    np.testing.assert_allclose(red(tile), np.array(SPOT) % TILE_PX, atol=1)
    whole = np.asarray(cv2.imread(str(tmp_path / "0" / "0" / "0.webp"), cv2.IMREAD_UNCHANGED))
    np.testing.assert_allclose(red(whole), np.array(SPOT) / 4, atol=1)
    assert (whole[:170, :24, 3] == 0).all()
    assert (whole[:170, 26:220, 3] == 255).all()


def test_only_zooms_that_tiles_can_have_are_replaced(tmp_path: Path) -> None:
    for name in ("24", "25", "2024"):
        (tmp_path / "tiles" / name).mkdir(parents=True)
    write_tiles(tmp_path / "tiles", raster(tmp_path / "m.tif", None), "plain", None)
    assert sorted(path.name for path in (tmp_path / "tiles").iterdir()) == ["0", "1", "2", "2024", "25", "index.html"]


def test_the_page_needs_no_network_and_quotes_its_title(tmp_path: Path) -> None:
    write_tiles(tmp_path, raster(tmp_path / "m.tif", None), "</script><b>", None)
    page = (tmp_path / "index.html").read_text()
    assert not re.search(r"https?://|src=|href=", page)
    (facts,) = map(json.loads, re.findall(r"const facts = (.*);", page))
    assert facts["title"] == "</script><b>"
    listed = {f"{column}/{row}.webp" for column, rows in facts["rows"].items() for row in rows}
    assert listed == {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.webp")}
    assert page.count("</script>") == 1


def test_mbtiles_have_the_same_tiles_where_gdal_finds_the_mosaic(tmp_path: Path) -> None:
    raw = raster(tmp_path / "m.tif", PLACE)
    pyramid = write_tiles(tmp_path / "tiles", raw, "m", None)
    write_mbtiles(tmp_path / "field.mbtiles", raw)
    with contextlib.closing(sqlite3.connect(tmp_path / "field.mbtiles")) as database:
        rows = database.execute("SELECT * FROM tiles").fetchall()
        about = dict(database.execute("SELECT * FROM metadata"))
    files = {f"{zoom}/{column}/{2**zoom - 1 - row}.webp": tile for zoom, column, row, tile in rows}
    written = (tmp_path / "tiles").rglob("*.webp")
    assert files == {path.relative_to(tmp_path / "tiles").as_posix(): path.read_bytes() for path in written}
    assert (about["name"], about["minzoom"], about["maxzoom"]) == ("field", str(pyramid.top), str(pyramid.zoom))
    with rasterio.open(tmp_path / "field.mbtiles") as made, rasterio.open(raw) as file:
        box = np.array(rasterio.warp.transform_bounds(file.crs, made.crs, *file.bounds))
        assert np.abs(np.array(made.bounds) - box).max() < made.res[0]
        x, y = rasterio.warp.transform(file.crs, made.crs, [430_000 + 64.0], [5_190_000 - 21.0])
        row, column = made.index(x[0], y[0])
        window = rasterio.windows.Window(column - 40, row - 40, 80, 80)
        assert np.abs(red(np.moveaxis(made.read([3, 2, 1], window=window), 0, -1)) - 40).max() < 1
        assert made.overviews(1) == [2, 4][: pyramid.zoom - pyramid.top]


STEP_M, TURN = 0.05, 0.3
NAME = "M.KMZ"


def smooth_raster(
    path: Path, size: tuple[int, int], turn: float = 0.0, east_m: float = 480_000, noise: bool = False
) -> Path:
    """A picture without a photograph in its first quarter; smooth, unless it is ``noise``."""
    rng, (width, height) = np.random.default_rng(0), size
    image = rng.integers(0, 255, (height // (1 if noise else 32), width // (1 if noise else 32), 3), dtype=np.uint8)
    image, shown = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), np.ones((height, width), np.uint16)
    shown[: height // 2, : width // 2] = 0
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
    write_kmz(path, smooth_raster(tmp_path / "raw.tif", size, turn))
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
    far = smooth_raster(tmp_path / "far.tif", (200, 100), east_m=499_995)
    with rasterio.open(far, "r+") as file:
        file.crs = "+proj=tmerc +lat_0=0 +lon_0=180 +k=0.9996 +x_0=500000 +datum=WGS84"
    with pytest.raises(InputError, match=rf"{NAME}: the mosaic reaches beyond Web Mercator \(across 180 degrees"):
        write_kmz(tmp_path / NAME, far)
    noise = smooth_raster(tmp_path / "raw.tif", (600, 700), noise=True)
    refused = pytest.raises(InputError, match=rf"{NAME}: cannot be written \(.*\); choose another folder")
    with limited_files(100_000), refused:
        write_kmz(tmp_path / NAME, noise)
    assert {each.name for each in tmp_path.iterdir()} == {"far.tif", "raw.tif"}
