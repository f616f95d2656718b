"""Puts a layout on the map: by the GPS positions of its cameras, or by ground control points."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import connected_components

from golden_model.arrays import Matrix, Points
from skymosaic.common.errors import InputError, RegistrationError, noting
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.layout.linked_group import join, separate
from skymosaic.flight.linking.links import WEAK_TIES, Link
from skymosaic.flight.mapping.cameras import Camera, cameras_of, measure_turn
from skymosaic.flight.mapping.contradictions import compare_places, doubt_records, doubt_scale
from skymosaic.geometry.homography import apply
from skymosaic.imagery.exif import Position, describe_gps_faults, explain_missing_gps
from skymosaic.imagery.orientation import AXES, UPRIGHT, turn_matrix
from skymosaic.imagery.photographs import index_names
from skymosaic.maps.control_points import ControlPoints
from skymosaic.maps.georeference import MIN_POSITIONS, Georeference, fit_to_map, map_to_globe, project_to_utm

MAX_SCALE_ERROR = 0.15
"""A required map, on which somebody may measure, is known better."""
MAX_AWAY_M = 10_000.0
"""Control points farther from the photographs are of another site, or their axes are swapped."""

TOLERANCE_M, TOLERANCE_SIGMAS = 3.0, 10.0
"""So far off is no error of ordinary GPS, nor of RTK by its own accuracy: the layout's error at a camera adds to it."""
SMOOTH = 0.25
"""What is left of such offsets, as a share of them, where another place for all of them together explains them."""


@dataclass(frozen=True, eq=False)
class MapPlace:
    """Where a layout lies on the map."""

    georeference: Georeference | None = None
    """Georeference of the layout's reference frame."""
    fitted_to: tuple[str, ...] = ()
    """Names of the photographs or control points that the georeference's offsets belong to."""
    by: str = "GPS"
    """Or "positions", "control points", or "other map"."""
    control: ControlPoints | None = None
    """The control points that it is fitted to, or ties to another map."""
    note: str = ""
    """Why there is none, or why it may be wrong; else empty."""
    height_m: float | None = None
    """Median height of the cameras above the ground, by the layout; None where no focal length is known."""
    recorded_height_m: float | None = None
    """Median of the heights that the cameras recorded, above where they started."""
    turned_deg: float | None = None
    """Median difference of the directions of the photographs from those that the cameras recorded, clockwise."""
    checked_m: dict[str, float] = field(default_factory=dict)
    """Distance of each check point from its place on the map. They had no part in the layout or its place."""
    contradictions: tuple[str, ...] = ()
    """What makes it doubtful, a line each: two sources that contradict each other, or a scale known badly."""

    @property
    def grid(self) -> Matrix | None:
        """The pixels of the other map, which the mosaic takes over, to metres."""
        return None if self.control is None else self.control.grid

    @property
    def disagreeing(self) -> list[tuple[str, float]]:
        """Photographs or control points that disagree with the others, and by how many metres, the worst first."""
        if (on_map := self.georeference) is None:
            return []
        offsets = [(self.fitted_to[index], on_map.offsets_m[index]) for index in on_map.disagreeing]
        return sorted(offsets, key=lambda item: -item[1])

    def describe_disagreeing(self) -> str:
        """Name the positions that the map is made without, as "the GPS of A (6 m off)"; empty if there are none."""
        if self.disagreeing and self.control is not None and self.control.tried:
            off = f"{len(self.disagreeing)} of {len(self.fitted_to)}"
            return f"{off} ties to the {self.by} (up to {self.disagreeing[0][1]:.1f} m off)"
        names = ", ".join(f"{name} ({offset:.0f} m off)" for name, offset in self.disagreeing)
        return names and f"the {self.by} of {names}"

    @property
    def checked_rms_m(self) -> float:
        """Root mean square of the distances of the check points."""
        return float(np.sqrt(np.mean(np.square(list(self.checked_m.values())))))


NOWHERE = MapPlace()


def explain_absence(path: Path, place: MapPlace) -> str:
    """Why a file has no place on the map, and what gives it one."""
    remedy = "GPS that fits, or mosaic with `positions` or `control_points`, gives it one"
    return f"{path} has no place on the map: {place.note}; {remedy}"


def require_place(path: Path, place: MapPlace) -> None:
    """Raise `RegistrationError` for a mosaic that has no place on the map, or none to be trusted."""
    if place.georeference is None:
        raise RegistrationError(f"{explain_absence(path, place)}; nothing was written")
    if place.georeference.scale_error > MAX_SCALE_ERROR:
        doubt = next(doubt_scale(place.georeference))
        raise RegistrationError(f"{path}: {doubt}; a required map needs {MAX_SCALE_ERROR:.0%}; nothing was written")


def place_on_map(flight: Flight, layout: Layout, control: ControlPoints | None = None) -> MapPlace:
    """Fit a layout to ground control points, or to the positions of its cameras, and hold it against their GPS.

    Raises
    ------
    InputError
        If the control points do not fit the layout, or GPS contradicts what it is fitted to by too much.
    """
    cameras = cameras_of(flight, layout)
    place, by = place_cameras(cameras), "GPS"
    if found := _find_break(layout, place, cameras):
        place = MapPlace(note=found)
    if flight.positions:
        own = [replace(each, taken=replace(each.taken, position=each.taken.own_position)) for each in cameras]
        known, by = place_cameras(own), f"positions ({flight.positions})"
        place = _hold_against(replace(place, by="positions"), by, known, "GPS", cameras)
    if control is not None:
        fitted = _fit_to_control_points(control, flight, layout)
        by_control = f"control points ({control.name})"
        place, by = _hold_against(fitted, by_control, place, by, cameras), by_control
    if (ties := flight.onto) is None:
        return place
    try:
        fitted = replace(_fit_to_control_points(ties, flight, layout), by="other map")
        return _hold_against(fitted, f"the map {ties.name}", place, by, cameras)
    except InputError as error:
        # Too few hold, or they contradict each other or the place without them.
        return replace(place, contradictions=(*place.contradictions, f"{error}; the mosaic is not laid onto it"))


def _find_break(layout: Layout, place: MapPlace, cameras: Sequence[Camera]) -> str:
    """Where a layout broke, by positions that disagree behind a joint in doubt; empty if it did not.

    Positions may be wrong, also several in a row. Where these agree among themselves, and what joins their part of the
    layout to the others is a single weak link, or contradicted by as many links as hold, they tell that it broke.
    """
    off = set(place.georeference.disagreeing) if place.georeference else set[int]()
    if place.georeference is None or len(off) < MIN_POSITIONS:
        return ""
    offsets_m = np.array(place.georeference.offsets_m)
    for side, hold, contradict in _doubtful_joints(layout):
        behind = sorted(off.intersection(side))
        if len(behind) < max(MIN_POSITIONS, np.isfinite(offsets_m[side]).sum() / 2):
            continue
        own = place_cameras([cameras[row] for row in behind]).georeference
        if own is not None and own.residual_m <= SMOOTH * np.median(offsets_m[behind]):
            surest = max(hold, key=lambda link: link.inliers)
            ends = [place.fitted_to[layout.members.index(end)] for end in (surest.left, surest.right)]
            return (
                f"the layout breaks between {ends[0]} and {ends[1]}, where {len(contradict)} of "
                f"{len(hold) + len(contradict)} links contradict it and the surest has {surest.ties} matches; behind, "
                f"it leaves {place.describe_disagreeing()}: fly again there"
            )
    return ""


def _doubtful_joints(layout: Layout) -> Iterator[tuple[list[int], list[Link], list[Link]]]:
    """Parts of a layout that as many links contradict as join to the others, or that a single weak one joins.

    Of each its rows, the links that join it, and those that contradict.
    """
    row = {member: index for index, member in enumerate(layout.members)}
    joined = join(layout.members, layout.links, [1] * len(layout.links))
    strong = [link for link in layout.links if link.ties >= WEAK_TIES]
    _, part = connected_components(join(layout.members, strong, [1] * len(strong)), directed=False)
    weak = [link for link in layout.links if part[row[link.left]] != part[row[link.right]]]
    for link in (*layout.contradicting, *weak):
        for side in separate(joined, row[link.left], row[link.right])[1]:
            inside = set(side)
            hold, contradict = (
                [each for each in links if (row[each.left] in inside) != (row[each.right] in inside)]
                for links in (layout.links, layout.contradicting)
            )
            if len(contradict) >= len(hold) or hold == [link]:
                yield side, hold, contradict


def _hold_against(place: MapPlace, by: str, other: MapPlace, by_other: str, cameras: Sequence[Camera]) -> MapPlace:
    """A place with the contradiction to another source of it, if both are known and contradict each other."""
    if place.georeference is None or other.georeference is None:
        return place
    below = np.array([camera.position[:2] for camera in cameras])
    found = compare_places(place.georeference, by, other.georeference, by_other, below)
    return replace(place, contradictions=(*place.contradictions, found)) if found else place


def list_contradictions(flight: Flight, control: ControlPoints | None = None) -> list[str]:
    """How the sources of a flight's place contradict each other or the layouts, also where a mosaic is refused.

    Single positions that disagree with the others are named, too.
    """
    found: list[str] = []
    for layout in flight.layouts:
        with noting(found):
            place = place_on_map(flight, layout, control)
            known = sum(flight.views[member].gps is not None for member in layout.members)
            refused = place.georeference is None and known >= MIN_POSITIONS
            found += [f"no place on the map: {place.note}"] if refused else place.contradictions
            if without := place.describe_disagreeing():
                found.append(f"a map is made without {without}")
    return found


def place_cameras(cameras: Sequence[Camera]) -> MapPlace:
    """Fit the cameras of a layout to their GPS positions."""
    positions = [camera.taken.position for camera in cameras if camera.taken.position is not None]
    if not positions:
        return MapPlace(note=explain_missing_gps([camera.taken for camera in cameras]))
    crs, metres = project_to_utm(positions)
    targets = np.full((len(cameras), 2), np.nan)
    targets[[camera.taken.position is not None for camera in cameras]] = metres
    names = tuple(camera.name for camera in cameras)
    # GPS belongs to the camera, not to what is in the middle of its photograph.
    places = np.array([camera.position for camera in cameras])
    tolerances_m = np.array([tolerance_m(camera.taken.accuracy_m) for camera in cameras])
    georeference, note = fit_to_map(places[:, :2], targets, crs, names, tolerances_m=tolerances_m)
    if georeference is None:
        faults = describe_gps_faults([camera.taken for camera in cameras]) if len(positions) < MIN_POSITIONS else ""
        return MapPlace(note=f"{note}; {faults}" if faults else note)
    turned = measure_turn(cameras, georeference.to_map, np.median(metres, axis=0), crs)
    if len(cameras) == 2:
        note = "two GPS positions fit exactly, so that nothing checks them"
        note += "" if turned is None else f" but the cameras' compass, which differs by {abs(turned):.0f} degrees"
    # The focal length of common drones is good enough for the place below a camera, and not for its height.
    known = all(camera.focal_half_diagonals or camera.taken.focal_half_diagonals for camera in cameras)
    height_m = float(np.median(places[:, 2])) * georeference.metres_per_pixel if known else None
    recorded = [camera.taken.height_m for camera in cameras if camera.taken.height_m is not None]
    recorded_m = float(np.median(recorded)) if recorded else None
    return MapPlace(
        georeference=georeference,
        fitted_to=names,
        note=note,
        height_m=height_m,
        recorded_height_m=recorded_m,
        turned_deg=turned,
        contradictions=(*doubt_scale(georeference), *doubt_records(height_m, recorded_m, turned)),
    )


def tolerance_m(accuracy_m: float | None) -> float:
    """How far off a camera's position may be without being wrong, by the accuracy that is recorded, if any."""
    return min(TOLERANCE_M, TOLERANCE_SIGMAS * (accuracy_m or np.inf))


def _fit_to_control_points(control: ControlPoints, flight: Flight, layout: Layout) -> MapPlace:
    if control.tried and len({member for member, *_ in sightings_of(control, flight, layout)}) < MIN_POSITIONS:
        raise InputError(f"{control.description}, and {MIN_POSITIONS} are needed")
    _check_site(control, flight, layout)
    place = _fit_to_clicks(control, flight, layout, as_stored=_are_clicked_as_stored(control, flight, layout))
    if place.georeference is None:
        raise InputError(f"{control.name}: {place.note}")
    return replace(place, control=control)


def _fit_to_clicks(control: ControlPoints, flight: Flight, layout: Layout, *, as_stored: bool) -> MapPlace:
    """Fit a layout to the control points that its photographs show, each at the mean of its sightings."""
    transforms = layout.to_reference(flight.views)
    places: dict[int, list[Points]] = {}
    for member, point, pixel in _locate(control, flight, layout, as_stored=as_stored):
        places.setdefault(point, []).append(apply(transforms[member], pixel))
    points = [point for point in sorted(places) if not control.checks(point)]
    if len(points) < MIN_POSITIONS:
        shown = f"the mosaic shows {len(points)} of its {len(control.names)} points; {MIN_POSITIONS} are needed"
        return MapPlace(note=f"{shown}: check the names of the photographs")
    means = {point: np.mean(each, axis=0) for point, each in places.items()}
    names = tuple(control.names[point] for point in points)
    georeference, reason = fit_to_map(
        np.array([means[point] for point in points]),
        control.metres[points],
        control.crs,
        names,
        in_time=bool(control.tried),
    )
    if georeference is None:
        return MapPlace(note=f"{reason}; check pixels, coordinates and their order (east comes first)")
    return MapPlace(
        georeference=georeference,
        fitted_to=names,
        by="control points",
        note=f"the pixels of {control.name} fit photographs as stored, before EXIF turns them" if as_stored else "",
        checked_m={
            control.names[point]: float(np.linalg.norm(apply(georeference.to_map, mean) - control.metres[point]))
            for point, mean in means.items()
            if control.checks(point)
        },
        contradictions=tuple(doubt_scale(georeference)),
    )


def _are_clicked_as_stored(control: ControlPoints, flight: Flight, layout: Layout) -> bool:
    """Whether the pixels of control points fit better in photographs as stored: some programs do not turn them."""
    if control.tried or all(flight.views[member].orientation == UPRIGHT for member in layout.members):
        return False
    fits = [_fit_to_clicks(control, flight, layout, as_stored=stored).georeference for stored in (False, True)]
    misfit_m, misfit_as_stored_m = (np.inf if fit is None else fit.residual_of_all_m for fit in fits)
    return misfit_as_stored_m < misfit_m


def sightings_of(control: ControlPoints, flight: Flight, layout: Layout) -> Iterator[tuple[int, int, Points]]:
    """The view, the point and the straightened pixel (2,) of each sighting in a layout's photographs."""
    return _locate(control, flight, layout, as_stored=_are_clicked_as_stored(control, flight, layout))


def _locate(
    control: ControlPoints, flight: Flight, layout: Layout, *, as_stored: bool
) -> Iterator[tuple[int, int, Points]]:
    find = index_names([flight.views[member].name for member in layout.members])
    for sighting in control.sightings:
        members = [layout.members[index] for index in find(sighting.photograph)]
        if len(members) > 1:
            raise InputError(f"{control.name}: {sighting.photograph} is {len(members)} photographs; add their folders")
        for member in members:
            view = flight.views[member]
            pixel = np.array([[sighting.x_px, sighting.y_px]])
            if as_stored:
                pixel = apply(turn_matrix(view.size, AXES[view.orientation]), pixel)
            if not control.tried:
                pixel = flight.lens.turned(view.orientation).straighten_points(pixel, view.size)
            yield member, sighting.point, layout.bend(member, view, pixel)[0]


def _check_site(control: ControlPoints, flight: Flight, layout: Layout) -> None:
    """Refuse control points far from where the photographs were taken, if known: swapped axes, or another site."""
    positions = [gps for member in layout.members if (gps := flight.views[member].gps) is not None]
    if not positions:
        return
    ((longitude_deg, latitude_deg),) = map_to_globe(np.median(control.metres, axis=0), control.crs).tolist()
    site = Position(latitude_deg, longitude_deg)
    away_m = float(np.linalg.norm(np.median([gps.metres_from(site) for gps in positions], axis=0)))
    if not away_m < MAX_AWAY_M:
        raise InputError(
            f"{control.name}: its points lie {away_m / 1000:.0f} km from the photographs' GPS; check the coordinate "
            "system, the order of the axes (east comes first) and the site"
        )
