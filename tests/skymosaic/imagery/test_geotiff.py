import cv2
import numpy as np
import pytest

from skymosaic.imagery.exif import Position
from skymosaic.imagery.geotiff import georeference, write_cog

rasterio = pytest.importorskip("rasterio")
warp = pytest.importorskip("rasterio.warp")


def utm(epsg: int, east: np.ndarray, north: np.ndarray) -> list[Position]:
    longitude, latitude = warp.transform(f"EPSG:{epsg}", "EPSG:4326", east, north)
    return [Position(lat, lon) for lat, lon in zip(latitude, longitude, strict=True)]


@pytest.mark.parametrize(("epsg", "false_north"), [(32615, 5_190_000.0), (32733, 6_240_000.0)])
def test_a_turned_and_scaled_layout_is_found_on_the_map(epsg, false_north):
    rng = np.random.default_rng(4)
    centres = rng.uniform(0, 4000, (12, 2))
    turn = 0.05 * np.exp(0.6j)  # metres a pixel, and the turn of the flight
    place = (centres[:, 0] - 1j * centres[:, 1]) * turn
    east, north = 430_000 + place.real, false_north + place.imag
    found, reason = georeference(centres, utm(epsg, east, north))
    assert reason == ""
    assert found.epsg == epsg
    assert found.residual_m < 1e-3
    assert found.metres_a_pixel == pytest.approx(0.05, rel=1e-6)
    mapped = centres @ found.to_map[:2, :2].T + found.to_map[:2, 2]
    np.testing.assert_allclose(mapped, np.column_stack([east, north]), atol=2e-3)


def test_the_residual_is_the_noise_of_the_positions():
    rng = np.random.default_rng(5)
    centres = rng.uniform(0, 4000, (400, 2))
    east, north = 430_000 + 0.05 * centres[:, 0], 5_190_000 - 0.05 * centres[:, 1]
    noisy = utm(32615, east + rng.normal(0, 2, 400), north + rng.normal(0, 2, 400))
    found, _ = georeference(centres, noisy)
    assert found.residual_m == pytest.approx(2 * np.sqrt(2), rel=0.1)


FAR_APART = [Position(46, -92), Position(46.01, -92)]


@pytest.mark.parametrize(
    ("gps", "message"),
    [
        ([None, None, *FAR_APART], "2 of 4"),
        ([Position(46, -92)] * 4, "coincide"),
        (FAR_APART * 2, "do not fit"),
        ([*FAR_APART, FAR_APART[0], Position(46, -92.002)], "too much"),
    ],
)
def test_positions_that_do_not_determine_the_map_are_refused(gps, message):
    centres = np.array([[0, 0], [0, 1000], [1000, 1000], [1000, 0]], dtype=np.float64)
    found, reason = georeference(centres, gps)
    assert found is None
    assert message in reason


def test_a_geotiff_says_where_it_lies(tmp_path):
    picture = cv2.GaussianBlur(np.random.default_rng(0).integers(1, 256, (700, 600, 3), dtype=np.uint8), (0, 0), 3)
    centres = np.array([[0, 0], [599, 0], [599, 699], [0, 699]], dtype=np.float64)
    places = utm(32615, 430_000 + 0.1 * centres[:, 0], 5_190_000 - 0.1 * centres[:, 1])
    found, _ = georeference(centres, places)
    write_cog(tmp_path / "map.tif", (600, 700), 3, [picture[:512], picture[512:]], found)
    with rasterio.open(tmp_path / "map.tif") as file:
        assert file.crs.to_epsg() == 32615
        # Rasterio gives the middle of the first pixel.
        np.testing.assert_allclose(file.xy(0, 0), (430_000, 5_190_000), atol=2e-3)
        assert file.overviews(1)
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        np.testing.assert_array_equal(file.read().transpose(1, 2, 0)[..., ::-1], picture)
    assert [path.name for path in tmp_path.iterdir()] == ["map.tif"]
