"""Fits a layout to ties and to known places at once: where cameras were, and surveyed points.

Ties leave a long flight free to bend, because small errors of many links add up. Positions are far less exact than
ties, but their errors do not add up.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Points
from skymosaic.common.errors import InputError
from skymosaic.compositing.warp import magnification
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.adjustment import Anchors
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.layout.linked_group import linked_group
from skymosaic.flight.linking.view import View
from skymosaic.flight.mapping.cameras import cameras_of
from skymosaic.flight.mapping.place import place_on_map, sightings_of
from skymosaic.geometry.homography import apply, rescale
from skymosaic.maps.control_points import ControlPoints
from skymosaic.maps.georeference import project

MAX_OUTSIDE = 2.0
"""Points farther from the middle of their view, in half diagonals, are left out, as below a camera that looks ahead."""
ROUNDS = 3
"""How often the layout is adjusted to its place on the map, and the place to the layout."""
CONTROL_M, CLICK_PX = 0.02, 1.0
"""Standard deviations of a surveyed point and of its place in a photograph."""
MIN_GPS_M = 0.01


@dataclass(frozen=True, eq=False)
class Observation:
    """A point of a view whose place is known."""

    view: int
    point: Points
    """(2,): working px of the view."""
    place: Points
    """(2,): ground px of the layout."""
    sigma_px: float
    """Standard deviation of the place, ground px."""


def fit_layout(flight: Flight, layout: Layout, control: ControlPoints | None = None) -> Layout:
    """Adjust a layout to its ties and to control points or GPS at once; without a place on the map it stays as it is.

    Check points have no part in it.
    """
    for _ in range(ROUNDS):
        try:
            observations = list(_observe(flight, layout, control))
        except InputError:
            # `place_on_map` says why, if a mosaic of this layout is wanted.
            return layout
        if not observations:
            return layout
        # The place on the map and the positions below the cameras follow from the layout, so both change with it.
        layout = anchor(layout, flight.views, observations)
    return layout


def _observe(flight: Flight, layout: Layout, control: ControlPoints | None) -> Iterator[Observation]:
    """What is known of places in a layout."""
    place = place_on_map(flight, layout, control)
    # A map that does not hold must not move the layout.
    if (on_map := place.georeference) is None or (flight.onto is not None and place.control is not flight.onto):
        return
    to_ground = np.asarray(np.linalg.inv(on_map.to_map @ flight.views[layout.reference].to_original), np.float64)
    px_per_m = magnification(flight.views[layout.reference].size, to_ground @ on_map.to_map) / on_map.metres_per_pixel
    if (control := place.control) is not None:
        scales = {m: magnification(flight.views[m].size, each) for m, each in layout.to_reference(flight.views).items()}
        for member, point, pixel in sightings_of(control, flight, layout):
            if not control.checks(point):
                seen = apply(np.asarray(np.linalg.inv(flight.views[member].to_original), np.float64), pixel)
                sigma_m = np.hypot(CONTROL_M, CLICK_PX * scales[member] * on_map.metres_per_pixel)
                yield Observation(member, seen, apply(to_ground, control.metres[point]), float(sigma_m) * px_per_m)
        return
    cameras = zip(layout.members, cameras_of(flight, layout), strict=True)
    known = [(member, camera, gps) for member, camera in cameras if (gps := camera.taken.position) is not None]
    for (member, camera, _), metres in zip(known, project([gps for *_, gps in known], on_map.crs), strict=True):
        below = apply(to_ground @ on_map.to_map, camera.position[:2])
        # Without a recorded accuracy, the misfit is the best estimate of it.
        sigma_m = max(camera.taken.accuracy_m or on_map.residual_m, MIN_GPS_M)
        seen = apply(np.asarray(np.linalg.inv(layout.transforms[member]), np.float64), below)
        yield Observation(member, seen, apply(to_ground, metres), sigma_m * px_per_m)


def anchor(layout: Layout, views: Sequence[View], observations: Sequence[Observation]) -> Layout:
    """Adjust a layout once more, to its ties and to observations; which links contradict it stays as it is."""
    group = linked_group(views, layout.members, layout.links, reference=layout.reference)
    row = {member: index for index, member in enumerate(group.members)}
    normalised = group.normalisations[group.reference]
    points = np.array([apply(group.normalisations[row[each.view]], each.point) for each in observations])
    near = np.linalg.norm(points, axis=1) <= MAX_OUTSIDE
    anchors = Anchors(
        views=np.array([row[each.view] for each in observations])[near],
        points=points[near],
        places=apply(normalised, np.array([each.place for each in observations]))[near],
        sigma=np.array([each.sigma_px for each in observations])[near] * normalised[0, 0],
    )
    network = group.network(slice(None))
    to_views = map(np.linalg.inv, group.normalisations)
    start = np.stack([rescale(normalised @ layout.transforms[m] @ view) for m, view in zip(row, to_views, strict=True)])
    adjusted = network.adjust(start, layout.model, anchors=anchors)
    return dataclasses.replace(
        layout, transforms=group.to_ground(adjusted), errors_px=tuple(network.errors_px(adjusted))
    )
