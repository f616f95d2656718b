"""Flights and pairs that become maps, and what is written beside them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio

from sim.scene import Flight
from skymosaic import mosaic
from skymosaic.common.errors import InputError
from tests.made import write_located
from tests.system.command_line import only_error, skymosaic
from tests.system.conftest import IMAGES, SIZE


def with_gps(path: Path, image: np.ndarray, east_m: float, north_m: float) -> None:
    """A JPEG whose EXIF says where it was taken, near 46 degrees north, 92 west."""
    tags = {0xA405: round(21.633 * 0.8 * SIZE[0] / (np.hypot(*SIZE) / 2))}
    write_located(path, image, (46.0, -92.0), (east_m, north_m), tags)


def test_gps_puts_the_mosaic_on_the_map(flight: Flight, tmp_path: Path) -> None:
    metres_per_pixel = 0.15
    for index, (image, pose) in enumerate(zip(flight.images, flight.poses, strict=True)):
        with_gps(tmp_path / f"{index}.jpg", image, metres_per_pixel * pose.x_px, -metres_per_pixel * pose.y_px)
    result = skymosaic("mosaic", tmp_path, "-o", "m.tif", "--report", "r", "--cache", "cache", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "EPSG:32615, 0.1" in result.stdout
    found = json.loads((tmp_path / "r" / "report.json").read_text())["mosaics"][0]
    # The cameras lean: their positions are not what is in the middle of their photographs.
    assert 0 < found["residual_m"] < 0.6
    outlines = json.loads((tmp_path / "r" / "footprints_1.geojson").read_text())["features"]
    assert [feature["properties"]["name"] for feature in outlines] == [f"{index}.jpg" for index in range(IMAGES)]
    areas_m2 = [feature["properties"]["area_m2"] for feature in outlines]
    assert np.median(areas_m2) == pytest.approx(SIZE[0] * SIZE[1] * metres_per_pixel**2, rel=0.1)
    (ring,) = outlines[0]["geometry"]["coordinates"]
    np.testing.assert_allclose(ring[0], [-92, 46], atol=2e-3)
    assert (tmp_path / "r" / "footprints_1.kml").read_text().count("<Placemark>") == IMAGES
    with rasterio.open(tmp_path / "m.tif") as file:
        assert file.crs.to_epsg() == 32615
        assert file.transform.a == -file.transform.e == pytest.approx(metres_per_pixel, rel=0.03)
        assert file.transform.b == file.transform.d == 0
        assert [file.width, file.height] == found["size"]


def test_a_pair_with_gps_becomes_a_geotiff(flight: Flight, tmp_path: Path) -> None:
    for index, east_m in ((0, 0.0), (1, 30.0)):
        with_gps(tmp_path / f"{index}.jpg", flight.images[index], east_m, 0.0)
    result = skymosaic("mosaic", "0.jpg", "1.jpg", "-o", "m.tif", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "nothing checks them" in result.stderr
    (tmp_path / "linked.tif").hardlink_to(tmp_path / "1.jpg")
    made = mosaic([tmp_path / "0.jpg", tmp_path / "1.jpg"])
    with pytest.raises(InputError, match=r"linked\.tif: is the same file as .*1\.jpg, one of the inputs"):
        made.save(tmp_path / "linked.tif", overwrite=True)
    made.save(tmp_path / "again.tif", require_map=True)
    with rasterio.open(tmp_path / "m.tif") as file, rasterio.open(tmp_path / "again.tif") as again:
        assert file.crs.to_epsg() == again.crs.to_epsg() == 32615
        np.testing.assert_array_equal(file.read(), again.read())


def test_report_and_geotiff_and_scale(folder: Path, surveyed: Path, tmp_path: Path) -> None:
    result = skymosaic(
        "mosaic", folder, "-o", "m.tif", "--report", "r", "--scale", "0.5", "--cache", surveyed, cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    report = json.loads((tmp_path / "r" / "report.json").read_text())
    assert report["mosaics"][0]["placed"] == IMAGES
    assert report["mosaics"][0]["median_error_px"] < 1.0
    assert "0 of 9 photographs have GPS" in report["mosaics"][0]["map_note"]
    assert "warning: m.tif has no place on the map: 0 of 9 photographs have GPS; GPS that fits" in result.stderr
    page = (tmp_path / "r" / "index.html").read_text()
    outlines, agreement = (part.count("<polygon") for part in page.split("</svg>")[:2])
    assert outlines == IMAGES
    assert agreement == sum(report["mosaics"][0]["overlaps"][key] for key in ("agree", "disagree", "cannot_tell"))
    assert (tmp_path / "r" / "mosaic_1.jpg").exists()
    height, width = cv2.imread(str(tmp_path / "m.tif")).shape[:2]
    assert [width, height] == report["mosaics"][0]["size"]
    assert width < 4 * SIZE[0] / 2


@pytest.mark.parametrize("output", ["m.tif", "m.png"])
def test_a_map_that_is_required_is_made_or_refused(folder: Path, tmp_path: Path, output: str) -> None:
    result = skymosaic("mosaic", folder, "-o", output, "--require-map", "--cache", "cache", cwd=tmp_path)
    reason = "m.tif has no place on the map: 0 of 9" if output == "m.tif" else "m.png: .png files are no maps"
    assert reason in only_error(result.stderr)
    assert result.returncode == (3 if output == "m.tif" else 2)
    assert not (tmp_path / output).exists()
    # Refused before the first feature.
    assert not list((tmp_path / "cache").glob("*"))
