"""Outlines of a mosaic's photographs on the globe, and where to fly again, as GeoJSON and KML."""

import contextlib
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Points
from skymosaic.common.errors import InputError
from skymosaic.flight.checking.fly_again import plan_again
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.output import Delivery
from skymosaic.geometry.homography import apply
from skymosaic.maps.features import SUFFIXES, Place, write_places
from skymosaic.maps.georeference import map_to_globe


def write_footprints(path: Path, delivery: Delivery) -> None:
    """Write the outlines to ``path`` with the suffixes ``.geojson`` and ``.kml``; the mosaic must be georeferenced."""
    on_map, composition = delivery.georeference, delivery.composition
    assert on_map is not None
    names = [delivery.flight.short_names[placement.source.name] for placement in composition.placements]
    places = []
    for name, corners in zip(names, outline_photographs(composition), strict=True):
        # GeoJSON asks for closed rings, counter-clockwise.
        ring = apply(on_map.to_map, np.concatenate([corners, corners[:1]])[::-1])
        area_m2 = cv2.contourArea(np.float32(ring - ring[0]))
        places.append(Place(name, "Polygon", map_to_globe(ring, on_map.crs), {"area_m2": round(area_m2, 2)}))
    for suffix in SUFFIXES:
        write_places(path.with_suffix(suffix), delivery.path.name, places)


def write_fly_again(path: Path, delivery: Delivery) -> None:
    """Write where to fly again, likewise; nothing for a flight that lacks nothing, or cannot say where without GPS."""
    with contextlib.suppress(InputError):
        places, _ = plan_again(delivery.flight, boundary=delivery.composition.boundary)
        for suffix in SUFFIXES if places else ():
            write_places(path.with_suffix(suffix), f"fly again: {delivery.path.name}", places)


def outline_photographs(composition: Composition) -> list[Points]:
    """Find the corners (N, 2) of what each placed photograph may show on the canvas, clockwise from the top left."""
    outlines = []
    for placement, transform in zip(composition.placements, composition.transforms, strict=True):
        # Corners of the photograph lie half a pixel outside the centres of its corner pixels.
        centre = (np.array(placement.size) - 1) / 2
        corners = (placement.outline - centre) * (np.array(placement.size) / (2 * centre)) + centre
        outlines.append(apply(transform, corners))
    return outlines
