"""Where a flight has to be flown again, held against what was taken out of it."""

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as XmlTree

import cv2
import numpy as np
import pytest
import rasterio.features

from golden_model.version import VERSION
from skymosaic.flight.checking.fly_again import find_holes
from skymosaic.maps.features import Place, write_places

SIZE_M, CELL_M = np.array([80.0, 60.0]), 0.25


def flown(rng: np.random.Generator, *, overlap: float, turn_deg: float) -> dict[tuple[int, int], np.ndarray]:
    """Outlines of six strips of eight photographs, as a drone in wind takes them, by strip and place in it."""
    turn = np.radians(turn_deg)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * SIZE_M / 2
    outlines = {}
    for strip in range(6):
        for place in range(8):
            middle = np.array([place, strip]) * SIZE_M * (1 - overlap) + rng.normal(0, 0.5, 2)
            yaw = np.radians(rng.normal(0, 1))
            yawed = corners @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
            outlines[strip, place] = (yawed + middle) @ axes + [500_000, 5_000_000]
    return outlines


def rasterise(rings: Any) -> np.ndarray:
    shapes = [{"type": "Polygon", "coordinates": [[*ring.tolist(), ring[0].tolist()]]} for ring in rings]
    if not shapes:
        return np.zeros((2400, 3200), np.uint8)
    to_map = rasterio.Affine(CELL_M, 0, 500_000 - 250, 0, CELL_M, 5_000_000 - 150)
    return rasterio.features.rasterize(shapes, (2400, 3200), transform=to_map, dtype="uint8")


@pytest.mark.parametrize("turn_deg", [0.0, 37.0])
@pytest.mark.parametrize(
    ("overlap", "lost"),
    [
        (0.2, {(2, 3)}),
        (0.35, {(3, place) for place in range(8)}),
        (0.4, {(strip, place) for strip in (2, 3) for place in (3, 4, 5)}),
        (0.3, {(1, 5), (1, 6), (4, 2)}),
    ],
)
def test_holes_are_what_the_lost_photographs_alone_showed(
    overlap: float, lost: set[tuple[int, int]], turn_deg: float
) -> None:
    outlines = flown(np.random.default_rng(3), overlap=overlap, turn_deg=turn_deg)
    kept = [ring for place, ring in outlines.items() if place not in lost]
    truth = rasterise(outlines.values()) & ~rasterise(kept) & 1
    holes = find_holes(kept)
    # Counter-clockwise, so their areas are positive.
    assert [cv2.contourArea(np.float32(ring - ring[0]), oriented=True) for ring, _ in holes] == pytest.approx(
        [area_m2 for _, area_m2 in holes]
    )
    found = rasterise([ring for ring, _ in holes])
    common = np.sum(truth & found)
    assert common / found.sum() > 0.97
    assert common / truth.sum() > 0.97
    assert sum(area_m2 for _, area_m2 in find_holes(kept)) == pytest.approx(found.sum() * CELL_M**2, rel=0.02)


@pytest.mark.parametrize("overlap", [0.1, 0.3, 0.6])
def test_a_whole_flight_has_no_holes(overlap: float) -> None:
    assert not find_holes(list(flown(np.random.default_rng(4), overlap=overlap, turn_deg=20).values()))


def test_a_notch_of_the_border_is_no_hole() -> None:
    """Between two photographs, a third lies 7 m lower: a notch 6 m wide, 0.8 % of a photograph."""
    corners = np.array([[0, 0], [80, 0], [80, 60], [0, 60]], np.float64)
    strip = [corners + np.array(step) for step in ((0, 0), (40, -7), (86, 0))]
    assert not find_holes(strip)


def test_places_are_read_as_they_were_written(tmp_path: Path) -> None:
    ring = np.array([[8.0, 46], [8.1, 46], [8.1, 46.1], [8, 46]])
    places = [
        Place("hole & 1", "Polygon", ring, {"area_m2": 3.5}),
        Place("link", "LineString", ring[:2]),
        Place("left out", "Point", ring[:1], {"reason": "blurred"}),
    ]
    for suffix in (".geojson", ".kml"):
        write_places(tmp_path / f"again{suffix}", "fly again", places)
    written = json.loads((tmp_path / "again.geojson").read_text())
    features = written["features"]
    assert (written["type"], written["version"]) == ("FeatureCollection", VERSION)
    assert [each["geometry"]["type"] for each in features] == ["Polygon", "LineString", "Point"]
    assert features[0]["geometry"]["coordinates"] == [ring.tolist()]
    assert features[0]["properties"] == {"name": "hole & 1", "area_m2": 3.5}
    assert features[2]["geometry"]["coordinates"] == [8, 46]
    root = XmlTree.parse(tmp_path / "again.kml").getroot()
    names = [element.text for element in root.iter("{http://www.opengis.net/kml/2.2}name")]
    assert names == ["fly again", "hole & 1", "link", "left out"]
    assert len(list(root.iter("{http://www.opengis.net/kml/2.2}coordinates"))) == 3
