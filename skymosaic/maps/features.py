"""Named places on the globe as GeoJSON and KML, for maps and flight planners."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as XmlTree

import numpy as np

from golden_model.arrays import Points
from golden_model.text import one_line
from skymosaic.common.provenance import to_json
from skymosaic.imagery.images import save_bytes

SUFFIXES = (".geojson", ".kml")
_KML = "http://www.opengis.net/kml/2.2"


@dataclass(frozen=True, eq=False)
class Place:
    """A place with a name."""

    name: str
    kind: Literal["Polygon", "LineString", "Point"]
    degrees: Points
    """Longitudes and latitudes (N, 2); of a polygon counter-clockwise, and the last repeats the first."""
    properties: Mapping[str, object] = field(default_factory=dict)
    """Further facts."""


def write_places(path: Path, title: str, places: Sequence[Place]) -> None:
    """Write places to a file, as its suffix says, one of `SUFFIXES`."""
    save_bytes(path, _kml(title, places) if path.suffix.lower() == ".kml" else _geojson(places))


def _geojson(places: Sequence[Place]) -> bytes:
    features = []
    for place in places:
        # Beyond 180 degrees rather than around the globe.
        points = np.round(np.unwrap(place.degrees, period=360, axis=0), 8).tolist()
        nested = {"Polygon": [points], "LineString": points, "Point": points[0]}[place.kind]
        geometry = {"type": place.kind, "coordinates": nested}
        about = {"name": place.name, **place.properties}
        features.append({"type": "Feature", "properties": about, "geometry": geometry})
    return to_json({"type": "FeatureCollection", "features": features})


def _kml(title: str, places: Sequence[Place]) -> bytes:
    root = XmlTree.Element("kml", xmlns=_KML)
    document = XmlTree.SubElement(root, "Document")
    XmlTree.SubElement(document, "name").text = one_line(title)
    for place in places:
        mark = XmlTree.SubElement(document, "Placemark")
        XmlTree.SubElement(mark, "name").text = one_line(place.name)
        data = XmlTree.SubElement(mark, "ExtendedData")
        for name, value in place.properties.items():
            XmlTree.SubElement(XmlTree.SubElement(data, "Data", name=name), "value").text = one_line(str(value))
        element: XmlTree.Element = mark
        around = ("outerBoundaryIs", "LinearRing") if place.kind == "Polygon" else ()
        for tag in (place.kind, *around, "coordinates"):
            element = XmlTree.SubElement(element, tag)
        element.text = " ".join(f"{longitude:.8f},{latitude:.8f}" for longitude, latitude in place.degrees)
    return bytes(XmlTree.tostring(root, encoding="utf-8", xml_declaration=True))
