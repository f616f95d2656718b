"""Lists of positions and control points, and places as features."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rasterio import Affine
from rasterio.crs import CRS

from skymosaic.common.errors import InputError
from skymosaic.imagery.exif import Position
from skymosaic.maps.boundary import Boundary, load_boundary
from skymosaic.maps.control_points import ControlPoints, Sighting, load_control_points
from skymosaic.maps.features import Place, write_places
from skymosaic.maps.georeference import reproject
from skymosaic.maps.positions import Fix, Positions, load_positions

LINES = """
# surveyed on Monday
544256.7 5320919.9 5 3044 2622 IMG_0525.jpg corner
544157.7\t5320899.2 5 4193 1552 IMG_0585.jpg
544256.7 5320919.9 5 100.5 200 sub/IMG_0600.jpg
"""


def loaded(tmp_path: Path, header: str, lines: str = LINES) -> ControlPoints:
    (tmp_path / "gcp_list.txt").write_text(header + lines)
    return load_control_points(tmp_path / "gcp_list.txt")


@pytest.mark.parametrize("header", ["EPSG:32610", "WGS84 UTM 10N", "+proj=utm +zone=10 +datum=WGS84 +units=m +no_defs"])
def test_points_and_their_sightings_are_read(tmp_path: Path, header: str) -> None:
    points = loaded(tmp_path, header)
    np.testing.assert_allclose(points.metres, [(544256.7, 5320919.9), (544157.7, 5320899.2)])
    assert points.names == ("corner", "point 2")
    assert points.sightings[2] == Sighting(0, "sub/IMG_0600.jpg", 100.5, 200)
    assert points.crs == "EPSG:32610" or points.crs.startswith(("+proj", "PROJCS"))


def test_names_of_points_and_photographs_are_read_as_typed(tmp_path: Path) -> None:
    lines = "\n1 2 3 1 1 a.jpg\n1 2 3 1 1 b.jpg CHK-1\n4 5 6 1 1 a.jpg west\n4 5 6 1 1 b.jpg CHK-2\n4 5 6 1 1 c.jpg\n"
    points = loaded(tmp_path, "EPSG:32610", lines)
    assert points.names == ("CHK-1", "CHK-2")
    assert points.checks(0)
    lines = '\n1 2 3 1 1 Flight South (1).JPG north end\n4 5 6 1 1 "DJI 2" CHK-1\n7 8 9 1 1 3.jpg\n'
    points = loaded(tmp_path, "EPSG:32610", lines)
    assert [sighting.photograph for sighting in points.sightings] == ["Flight South (1).JPG", "DJI 2", "3.jpg"]
    assert points.names == ("north", "CHK-1", "point 3")


def test_a_byte_order_mark_does_not_matter_and_degrees_become_metres(tmp_path: Path) -> None:
    assert loaded(tmp_path, "\ufeffEPSG:32610").crs == "EPSG:32610"
    points = loaded(tmp_path, "EPSG:4326", "\n-92.0 46.8 200 10 20 a.jpg\n-91.99 46.8 200 10 20 b.jpg\n")
    assert points.crs == "EPSG:32615"
    assert np.hypot(*(points.metres[1] - points.metres[0])) == pytest.approx(763, abs=2)


def test_a_file_that_cannot_be_read_is_named_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "latin.txt").write_bytes("EPSG:32610\n1 2 3 1 1 Höhe.jpg".encode("latin-1"))
    for name, reason in (("latin.txt", "'utf-8' codec can't decode"), ("none.txt", "No such file or directory")):
        with pytest.raises(
            InputError, match=rf"{name}: cannot be read \({reason}.*; give a text file of control points, in UTF-8"
        ):
            load_control_points(tmp_path / name)


@pytest.mark.parametrize(
    "header", ["EPSG:3857", "EPSG:2264", "+proj=utm +zone=17 +datum=WGS84 +units=us-ft +no_defs", "EPSG:3347"]
)
def test_feet_and_stretched_metres_become_metres_on_the_ground(tmp_path: Path, header: str) -> None:
    degrees = np.array([(-80.0, 35.5), (-79.99, 35.5)])
    (x1, y1), (x2, y2) = reproject(degrees, "EPSG:4326", CRS.from_user_input(header).to_wkt())
    points = loaded(tmp_path, header, f"\n{x1} {y1} 200 10 20 a.jpg\n{x2} {y2} 200 10 20 b.jpg\n")
    assert points.crs == "EPSG:32617"
    assert points.metres[1] - points.metres[0] == pytest.approx((907, 9), abs=2)


@pytest.mark.parametrize(
    ("header", "place", "offset", "system", "step"),
    [
        # Another datum, and grads from Paris.
        ("EPSG:4230", (2.0, 48.0), (0.01, 0), "EPSG:32631", (746, -9)),
        ("EPSG:4807", (0.0, 53.0), (0.01, 0), "EPSG:32631", (674, -6)),
        # Maps in metres stay: oblique Mercator, and Krovak in the west.
        ("EPSG:2056", (2_600_000, 1_200_000), (50, 0), "EPSG:2056", (50, 0)),
        ("EPSG:5514", (-886_000, -1_006_000), (50, 0), "EPSG:5514", (50, 0)),
        # Axes that point west and south, and south and west.
        ("EPSG:2048", (-1000, 3_652_000), (0, -100), "EPSG:32734", (0, 100)),
        ("EPSG:5513", (1_006_000, 886_000), (0, -100), "EPSG:32633", (99.2, 12.9)),
    ],
)
def test_points_of_any_system_become_metres_to_the_east_and_north(
    tmp_path: Path, header: str, place: Any, offset: Any, *, system: str, step: Any
) -> None:
    given = np.array([place, np.add(place, offset)])
    points = loaded(tmp_path, header, "".join(f"\n{x} {y} 200 10 20 a.jpg" for x, y in given))
    assert points.crs == system
    np.testing.assert_allclose(points.metres, reproject(given, header, system), atol=0.01)
    assert points.metres[1] - points.metres[0] == pytest.approx(step, abs=4)


POSITIONS_LINES = """
# second battery
a/DJI_1.JPG -91.994 46.842 198.6
b/DJI_1.JPG -91.993 46.842 198.6 10 0 0 0.03 0.05
DJI_2.JPG -91.992 46.842
"""


def loaded_positions(tmp_path: Path, header: str, lines: str = POSITIONS_LINES) -> Positions:
    (tmp_path / "geo.txt").write_text(header + lines)
    return load_positions(tmp_path / "geo.txt")


@pytest.mark.parametrize(
    ("read", "header", "lines", "says"),
    [
        (loaded, "EPSG:32610", "", "no control points"),
        (loaded, "somewhere", LINES, "'somewhere' is no coordinate system"),
        (loaded, '{"init":5}', LINES, "is no coordinate system"),
        (loaded, "WGS84 UTM 61N", LINES, "'WGS84 UTM 61N' is no coordinate system"),
        (loaded, "EPSG:4978", LINES, "has no map coordinates"),
        (loaded, "EPSG:5703", LINES, "has no map coordinates"),
        (loaded, "EPSG:4326", "\n46.8 -92 200 10 20 a.jpg\n46.8 -91.9 200 10 20 b.jpg", "a latitude beyond 90 degrees"),
        (loaded, "EPSG:4807", "\n0 -101 200 10 20 a.jpg", "Invalid latitude; check the coordinate system"),
        (
            loaded,
            "EPSG:32610",
            "\n-92 46.8 200 10 20 a.jpg\n-91.99 46.8 200 10 20 b.jpg",
            "are degrees, but EPSG:32610 is",
        ),
        (loaded, "EPSG:32610", "\n1 2 3 4 5", "line 2 is '1 2 3 4 5'"),
        (loaded, "EPSG:32610", "\n1 2 3 4 nan a.jpg", "line 2"),
        (loaded_positions, "EPSG:4326", "", "no positions"),
        (loaded_positions, "EPSG:4326", "\n1.jpg 46.8 -92", "a latitude beyond 90"),
        (loaded_positions, "EPSG:4326", "\n1.jpg 268 46.8", "a longitude beyond 180"),
        (loaded_positions, "EPSG:32615", "\n1.jpg 5e7 1e8", "check the coordinate system"),
        (loaded_positions, "EPSG:4326", "\n1.jpg 46.8", "line 2 is '1.jpg 46.8'"),
        (
            loaded_positions,
            "EPSG:32615",
            POSITIONS_LINES,
            "its coordinates are degrees, but EPSG:32615 is in metres; begin with EPSG:4326",
        ),
        (loaded_positions, "EPSG:4326", "\n1.jpg -92 46.8 0 0 0 0 -0.02", "line 2"),
        (loaded_positions, "EPSG:4326", "\n1.jpg -92 46.8\n2.jpg -92 46.8 nan", "line 3"),
    ],
)
def test_a_file_of_another_form_is_one_line(
    tmp_path: Path, read: Callable[..., object], header: str, lines: str, says: str
) -> None:
    with pytest.raises(InputError) as refused:
        read(tmp_path, header, lines)
    assert says in str(refused.value)
    assert str(refused.value).startswith(str(tmp_path / ("gcp_list.txt" if read is loaded else "geo.txt")))
    assert "\n" not in str(refused.value)


def test_positions_and_their_accuracy_belong_to_photographs_of_any_name(tmp_path: Path) -> None:
    positions = loaded_positions(tmp_path, "EPSG:4326")
    assert positions.fixes[1] == Fix("b/DJI_1.JPG", Position(46.842, -91.993), 0.03)
    found = positions.find(["flight/b/DJI_1.jpg", "flight/a/dji_1.jpg", "flight/c/DJI_3.JPG", "flight/c/DJI_2.JPG"])
    assert [fix and fix.position.longitude_deg for fix in found] == [-91.993, -91.994, None, -91.992]
    lines = '\nFlight South (1).JPG -91.994 46.842 100\n"no suffix, 2" -91.993 46.842\nDJI_3.tif.old -91 46\n'
    names = [fix.photograph for fix in loaded_positions(tmp_path, "EPSG:4326", lines).fixes]
    assert names == ["Flight South (1).JPG", "no suffix, 2", "DJI_3.tif.old"]


@pytest.mark.parametrize(
    ("written", "accuracy_m"),
    [("0", None), ("0.0", None), ("0.02", 0.02), ("1e-3", 0.001), ("", None), ("0.02 fixed", 0.02)],
)
def test_an_accuracy_of_zero_is_unknown(tmp_path: Path, written: str, accuracy_m: float | None) -> None:
    (fix,) = loaded_positions(tmp_path, "EPSG:4326", f"\n1.jpg -92 46.8 0 0 0 0 {written}\n").fixes
    assert fix == Fix("1.jpg", Position(46.8, -92.0), accuracy_m)


@pytest.mark.parametrize(
    ("photographs", "says"),
    [
        (["DJI_2.JPG", "x/a/DJI_1.JPG"], "b/DJI_1.JPG is no photograph"),
        (["b/DJI_1.JPG", "x/a/DJI_1.JPG", "y/a/DJI_1.JPG"], "a/DJI_1.JPG is 2 photographs; add their folders"),
    ],
)
def test_names_that_are_not_one_photographs_are_refused(tmp_path: Path, photographs: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says):
        loaded_positions(tmp_path, "EPSG:4326").find(photographs)


def test_a_photograph_has_one_position(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"1\.JPG has two positions"):
        loaded_positions(tmp_path, "EPSG:4326", "\n1.jpg -92 46\n1.JPG -92.1 46\n").find(["1.jpg"])


def test_an_outline_across_180_degrees_does_not_run_around_the_globe(tmp_path: Path) -> None:
    ring = np.array([[179.999, -16.5], [-179.999, -16.5], [-179.999, -16.4], [179.999, -16.4], [179.999, -16.5]])
    write_places(tmp_path / "a.geojson", "flight", [Place("a.jpg", "Polygon", ring)])
    (feature,) = json.loads((tmp_path / "a.geojson").read_text())["features"]
    (written,) = feature["geometry"]["coordinates"]
    assert [longitude for longitude, _ in written] == [179.999, 180.001, 180.001, 179.999, 179.999]
    assert [latitude for _, latitude in written] == [-16.5, -16.5, -16.4, -16.4, -16.5]


RING = [[8.0, 47.0], [8.001, 47.0], [8.001, 47.001], [8.0, 47.001]]
HOLE = [[8.0002, 47.0002], [8.0004, 47.0002], [8.0004, 47.0004]]


def geojson(rings: object, kind: str = "Polygon", **more: object) -> str:
    return json.dumps({"type": "Feature", "geometry": {"type": kind, "coordinates": rings}, **more})


def kml(**rings: list[list[float]]) -> str:
    """A polygon of rings of both sides, whose corners have a height."""
    parts = ""
    for side, ring in rings.items():
        corners = " ".join(f"{x},{y},5" for x, y in ring)
        parts += f"<{side}BoundaryIs><LinearRing><coordinates>{corners}</coordinates></LinearRing></{side}BoundaryIs>"
    return f'<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><Polygon>{parts}</Polygon></Placemark></kml>'


def loaded_boundary(tmp_path: Path, name: str, text: str) -> Boundary:
    (tmp_path / name).write_text(text)
    return load_boundary(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.geojson", geojson([RING, HOLE])),
        ("a.json", geojson([RING, HOLE, [[x + 0.005, y] for x, y in HOLE]])),
        ("a.KML", kml(outer=RING, inner=HOLE)),
    ],
)
def test_an_area_keeps_its_holes_on_the_map(tmp_path: Path, name: str, text: str) -> None:
    area = loaded_boundary(tmp_path, name, text).in_system("EPSG:32632")
    (west, south), (east, north) = area.points.min(axis=0), area.points.max(axis=0)
    middle = (west + east) / 2
    outline = np.array([(west, south), (west, north), (middle, north), (middle, south)])
    assert area.share_shown([outline]) == pytest.approx(0.48 / 0.98, abs=2e-3)
    assert area.mask((100, 100), Affine(1, 0, west, 0, -1.15, north)).sum() == pytest.approx(0.98 * 76 * 97, rel=0.02)
    assert area.metres_to(Position(47.0005, 8.0005)) == 0
    assert area.metres_to(Position(47.0005, 8.011)) == pytest.approx(760, rel=0.01)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.geojson", geojson([[RING[0], RING[2], RING[1], RING[3]]]), "a polygon crosses itself near 8"),
        (
            "a.geojson",
            geojson([RING, [[8.0005, 47.0005], [8.002, 47.0005], [8.0005, 47.0008]]]),
            "crosses itself near 8",
        ),
        ("a.geojson", geojson([[[5e5, 5.2e6], [5e5, 5.3e6], [6e5, 5.3e6]]]), "a longitude beyond 180"),
        ("a.geojson", geojson([RING], crs={"type": "name", "properties": {"name": "here"}}), "'here' is no coordinate"),
        ("a.geojson", geojson(RING, "LineString"), "has no polygon; draw the area as one"),
        ("a.geojson", geojson([]), "a polygon has no outer ring"),
        ("a.kml", kml(inner=RING), "a polygon has no outer ring"),
        ("a.geojson", geojson([RING[:2]]), "a ring has at least three corners"),
        ("a.geojson", geojson([[[8, None], [9, 47], [9, 48]]]), "is no geojson file of polygons"),
        ("a.geojson", "[" * 100_000, "is no geojson file of polygons"),
        ("a.kml", "<kml><Polygon>", "is no kml file of polygons"),
        ("a.gpkg", "SQLite format 3", "is read from .geojson and .kml files; convert it"),
    ],
)
def test_what_is_no_area_is_one_line(tmp_path: Path, name: str, text: str, says: str) -> None:
    with pytest.raises(InputError) as refused:
        loaded_boundary(tmp_path, name, text)
    assert says in str(refused.value)
    assert str(refused.value).startswith(str(tmp_path / name))
