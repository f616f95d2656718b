"""Outlines of a mosaic's photographs on the globe, as GeoJSON and KML."""

import json
from pathlib import Path
from xml.etree import ElementTree as XmlTree

import numpy as np

from golden_model.arrays import Points
from golden_model.text import one_line
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.output import Delivery
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import save_bytes
from skymosaic.imagery.photographs import short_names
from skymosaic.maps.georeference import map_to_globe

_KML = "http://www.opengis.net/kml/2.2"


def write_footprints(path: Path, delivery: Delivery) -> None:
    """Write the outlines to ``path`` with the suffixes ``.geojson`` and ``.kml``; the mosaic must be georeferenced."""
    outlines = _outlines_on_globe(delivery)
    features = [
        {
            "type": "Feature",
            "properties": {"name": name},
            "geometry": {"type": "Polygon", "coordinates": [np.round(outline, 8).tolist()]},
        }
        for name, outline in outlines.items()
    ]
    collection = json.dumps({"type": "FeatureCollection", "features": features}, indent=1)
    save_bytes(path.with_suffix(".geojson"), (collection + "\n").encode())
    save_bytes(path.with_suffix(".kml"), _kml(delivery.path.name, outlines))


def outline_photographs(composition: Composition) -> list[Points]:
    """Find the corners (N, 2) of what each placed photograph may show on the canvas, clockwise from the top left."""
    outlines = []
    for placement, transform in zip(composition.placements, composition.transforms, strict=True):
        # Corners of the photograph lie half a pixel outside the centres of its corner pixels.
        centre = (np.array(placement.size) - 1) / 2
        corners = (placement.outline - centre) * (np.array(placement.size) / (2 * centre)) + centre
        outlines.append(apply(transform, corners))
    return outlines


def _outlines_on_globe(delivery: Delivery) -> dict[str, Points]:
    """Longitudes and latitudes (N, 2) of the corners of each photograph; the last repeats the first."""
    on_map, composition = delivery.georeference, delivery.composition
    assert on_map is not None
    # GeoJSON asks for counter-clockwise rings.
    closed = (np.concatenate([corners, corners[:1]])[::-1] for corners in outline_photographs(composition))
    rings = [apply(on_map.to_map, corners) for corners in closed]
    names = short_names([placement.source.name for placement in composition.placements])
    return {name: map_to_globe(ring, on_map.crs) for name, ring in zip(names, rings, strict=True)}


def _kml(title: str, outlines: dict[str, Points]) -> bytes:
    root = XmlTree.Element("kml", xmlns=_KML)
    document = XmlTree.SubElement(root, "Document")
    XmlTree.SubElement(document, "name").text = one_line(title)
    for name, outline in outlines.items():
        place = XmlTree.SubElement(document, "Placemark")
        XmlTree.SubElement(place, "name").text = one_line(name)
        ring: XmlTree.Element = place
        for tag in ("Polygon", "outerBoundaryIs", "LinearRing", "coordinates"):
            ring = XmlTree.SubElement(ring, tag)
        ring.text = " ".join(f"{longitude:.8f},{latitude:.8f}" for longitude, latitude in outline)
    return bytes(XmlTree.tostring(root, encoding="utf-8", xml_declaration=True))
