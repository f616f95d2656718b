"""A flight with GPS on the panel's map."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD
from playwright.sync_api import Page, expect

from sim.backends.interface import silent
from sim.scene import make_lawnmower
from skymosaic.panel.options import Options
from skymosaic.panel.tasks.mosaic_tasks import make_mosaic
from tests.skymosaic.panel.test_accessibility import barriers
from tools.panel import visit

PHOTOGRAPHS = 4
METRES_A_PIXEL = 0.15
NORTH_DEG, EAST_DEG = 46.0, 7.0
METRES_A_DEGREE = 111_147

Flight = dict[Path, tuple[float, float]]
"""Photographs, and the latitude and longitude above which each was taken."""

pytest.importorskip("rasterio")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    folder = tmp_path_factory.mktemp("flight")
    rendered = make_lawnmower(seed=9, images=PHOTOGRAPHS, size=(400, 300))
    taken = {}
    for number, (image, pose) in enumerate(zip(rendered.images, rendered.poses, strict=True)):
        north = NORTH_DEG - METRES_A_PIXEL * pose.y_px / METRES_A_DEGREE
        east = EAST_DEG + METRES_A_PIXEL * pose.x_px / (METRES_A_DEGREE * math.cos(math.radians(NORTH_DEG)))
        exif = Image.Exif()
        minutes = [(math.floor(angle), 60 * (angle % 1), 0.0) for angle in (north, east)]
        exif.get_ifd(IFD.GPSInfo).update({1: "N", 2: minutes[0], 3: "E", 4: minutes[1]})
        path = folder / f"DJI_{number}.jpg"
        Image.fromarray(image[..., ::-1]).save(path, quality=92, exif=exif)
        taken[path] = north, east
    return taken


def test_photographs_with_gps_become_a_geotiff_and_a_map(flight: Flight, tmp_path: Path) -> None:
    (tmp_path / "views").mkdir()
    for path in flight:
        (tmp_path / path.name).hardlink_to(path)
    names = [path.name for path in flight]
    result = make_mosaic(tmp_path, names, Options.of_preset("aerial"), tmp_path / "views", progress=silent)
    assert "mosaic.tif" in [path.name for path in result.files]
    assert "-o mosaic.tif" in result.command
    shown = result.map
    assert shown is not None
    south, west, north, east = shown.bounds
    for path, (latitude, longitude) in flight.items():
        centre = np.mean(shown.outlines[path.name], axis=0)
        # The cameras lean by up to two degrees: what is in the middle is some metres from below the camera.
        away = (centre - (latitude, longitude)) * (1, math.cos(math.radians(NORTH_DEG)))
        assert np.hypot(*away) * METRES_A_DEGREE < 5
        assert south < latitude < north
        assert west < longitude < east
    picture = cv2.imread(str(shown.picture), cv2.IMREAD_UNCHANGED)
    assert picture.shape[2] == 4
    assert 0.5 < (picture[..., 3] == 255).mean() <= 1


@pytest.mark.slow
def test_the_map_shows_the_mosaic_and_asks_no_other_server(page: Page, panel: str, flight: Flight) -> None:
    addresses: list[str] = []
    page.on("request", lambda request: addresses.append(request.url))
    page.get_by_label("Choose photographs").set_input_files(list(flight))
    expect(visit.photographs_loaded(page)).to_have_count(PHOTOGRAPHS)
    visit.make_mosaic(page)
    with page.expect_download() as download:
        page.get_by_role("link", name="mosaic.tif").click()
    assert download.value.suggested_filename == "mosaic.tif"
    visit.open_tab(page, "Map")
    expect(page.locator(".leaflet-image-layer")).to_be_visible()
    page.get_by_role("switch", name="Outlines on the map").click()
    expect(page.locator('.leaflet-overlay-pane path[stroke-opacity="1"]')).to_have_count(PHOTOGRAPHS)
    assert [address for address in addresses if not address.startswith((panel, "data:", "blob:"))] == []
    assert barriers(page) == []
