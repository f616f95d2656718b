"""Ties the photographs of a flight to a map that exists already, as control points do."""

from pathlib import Path

import numpy as np

from golden_model.arrays import Matrix, Points
from skymosaic.common.errors import InputError
from skymosaic.flight.flight import Flight
from skymosaic.flight.mapping.place import place_on_map
from skymosaic.geometry.homography import apply
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.maps.base_map import BaseMap
from skymosaic.maps.control_points import ControlPoints, Sighting, convert_to_metres
from skymosaic.maps.georeference import reproject
from skymosaic.registration.options import RegistrationOptions
from skymosaic.registration.register import register_photographs
from skymosaic.running.workers import Workers

TIES = 30
"""Ties of a photograph that are kept: more of them would have the same errors in common."""


def tie_to_map(
    base: BaseMap, flight: Flight, control: ControlPoints | None, seed: int, workers: Workers
) -> ControlPoints:
    """Register each placed photograph with the piece of the map below it, and keep the ties of those that hold."""
    calls = []
    for layout in flight.layouts:
        if (place := place_on_map(flight, layout, control).georeference) is not None:
            for member, transform in layout.to_reference(flight.views).items():
                view, to_place = flight.views[member], place.to_map @ transform
                frame = view.working_size, to_place @ view.to_original, place.crs
                calls.append((flight.sources[member], flight.lens, base, frame, seed))
    held = [ties for ties in workers.run("map", _tie, calls) if ties is not None]
    if calls and not held:
        raise InputError(f"{base.name}: shows too little of the photographs' ground; give a map of it")
    sightings = [(name, *pixel) for name, pixels, _ in held for pixel in pixels.tolist()]
    places = np.concatenate([np.zeros((0, 2)), *(places for *_, places in held)])
    crs, metres = convert_to_metres(Path(base.name), base.crs, places) if len(places) else (base.crs, places)
    return ControlPoints(
        base.name,
        crs,
        metres,
        tuple(f"{Path(name).name} {number}" for number, (name, *_) in enumerate(sightings)),
        tuple(Sighting(number, *each) for number, each in enumerate(sightings)),
        tried=len(calls),
        grid=base.grid if crs == base.crs else None,
    )


def _tie(
    source: Source, lens: Lens, base: BaseMap, frame: tuple[tuple[int, int], Matrix, str], seed: int
) -> tuple[str, Points, Points] | None:
    """Name and points of a straightened photograph, px, and their places on a map, which may not show it: None."""
    (width_px, height_px), to_place, crs = frame
    # A map has the parallax of its own cameras. Its piece is turned by half a circle, because nearly all of it would
    # have to agree if it were the picture of a camera that stood still. It is cut out by an affine map, which need not
    # be that of the photograph.
    last = np.array([width_px, height_px]) - 1
    start, *ends = apply(to_place, np.array([last, last * [0, 1], last * [1, 0]]))
    to_map = np.eye(3)
    to_map[:2] = np.column_stack([*((end - start) / side for end, side in zip(ends, last, strict=True)), start])
    if (piece := base.cut((width_px, height_px), to_map, crs)) is None:
        return None
    options = RegistrationOptions(working_width_px=width_px, seed=seed)
    pair = register_photographs((source.read_photograph(lens), piece), options, seconds={}, lens=lens)
    pixels, on_piece, *_ = pair.points()
    some = np.random.default_rng(seed).permutation(len(pixels))[: TIES if pair.accepted else 0]
    return source.name, pixels[some], reproject(apply(to_map, on_piece[some]), crs, base.crs)
