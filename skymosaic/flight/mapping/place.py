"""Puts a layout on the map: by the GPS positions of its cameras, or by ground control points."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from golden_model.arrays import Array, Matrix, Points
from skymosaic.common.errors import InputError
from skymosaic.compositing.warp import magnification
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.layout.motions import FOCAL_HALF_DIAGONALS
from skymosaic.flight.mapping.anchoring import Observation, anchor
from skymosaic.flight.survey import Flight
from skymosaic.geometry.homography import apply
from skymosaic.imagery.exif import Metadata
from skymosaic.imagery.photographs import index_names, short_names
from skymosaic.maps.control_points import ControlPoints
from skymosaic.maps.georeference import MIN_POSITIONS, Georeference, fit_to_map, map_to_globe, project_to_utm, reproject

ROUNDS = 3
"""How often the layout is adjusted to its place on the map, and the place to the layout."""
CONTROL_M, CLICK_PX = 0.02, 1.0
"""Standard deviations of a surveyed point and of its place in a photograph."""
MIN_GPS_M = 0.01
MAX_AWAY_M = 10_000.0
"""Control points farther from the photographs are of another site, or their axes are swapped."""
MIN_GSD = 0.99
"""A ground resolution is refused below this share of the photographs' own: enlarging them shows nothing new."""


@dataclass(frozen=True, eq=False)
class MapPlace:
    """Where a layout lies on the map.

    Attributes
    ----------
    georeference : Georeference or None
        Georeference of the layout's reference frame.
    fitted_to : tuple of str
        Names of the photographs or control points that the georeference's offsets belong to.
    by : {"GPS", "control points"}
    note : str
        Why there is none, or why it may be wrong; else empty.
    height_m : float or None
        Median height of the cameras above the ground, by the layout.
    recorded_height_m : float or None
        Median of the heights that the cameras recorded, above where they started.
    turned_deg : float or None
        Median difference of the directions of the photographs from those that the cameras recorded, clockwise.
    checked_m : dict of str to float
        Distance of each check point from its place on the map. They had no part in the layout or its place.
    """

    georeference: Georeference | None = None
    fitted_to: tuple[str, ...] = ()
    by: str = "GPS"
    note: str = ""
    height_m: float | None = None
    recorded_height_m: float | None = None
    turned_deg: float | None = None
    checked_m: dict[str, float] = field(default_factory=dict)


NOWHERE = MapPlace()


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera above its photograph.

    Attributes
    ----------
    name : str
        Name of the photograph.
    size : (int, int)
        Width and height, px.
    to_reference : ndarray of float64, shape (3, 3)
        Its pixels to the reference frame of the layout.
    taken : Metadata
        What the camera recorded.
    focal_half_diagonals : float or None
        Focal length, half diagonals of the photograph; None: as recorded, else that of common drones.
    """

    name: str
    size: tuple[int, int]
    to_reference: Matrix
    taken: Metadata
    focal_half_diagonals: float | None = None

    @cached_property
    def position(self) -> Array:
        """x and y in the reference frame, and height above it (3,), px.

        A camera that leans sees ground beside the place below it: at a height of 100 m, one degree makes 1.7 m. The
        position follows from the homography, as for a calibrated camera over a plane (Zhang 2000, section 3.1).
        """
        width, height = self.size
        focal = self.focal_half_diagonals or self.taken.focal_half_diagonals or FOCAL_HALF_DIAGONALS
        focal_px = focal * float(np.hypot(width, height)) / 2
        camera = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
        pose = np.linalg.inv(self.to_reference @ camera)
        pose /= (np.linalg.norm(pose[:, 0]) + np.linalg.norm(pose[:, 1])) / 2
        # The nearest rotation: noise, and ground that is not quite flat, leave the columns not quite orthogonal.
        left, _, right = np.linalg.svd(np.column_stack((pose[:, 0], pose[:, 1], np.cross(pose[:, 0], pose[:, 1]))))
        x, y, z = -(left @ right).T @ pose[:, 2]
        return np.array([x, y, abs(z)])


def explain_absence(path: Path, place: MapPlace, remedy: str = "photographs with GPS, or --gcp FILE") -> str:
    """Why a file has no place on the map, and what gives it one."""
    return f"{path} has no place on the map: {place.note}; {remedy}, give it one"


def place_on_map(flight: Flight, layout: Layout, control: ControlPoints | None = None) -> MapPlace:
    """Fit a layout to ground control points, or to the GPS positions of its photographs.

    Raises
    ------
    InputError
        If the control points do not fit the layout.
    """
    if control is not None:
        return _fit_to_control_points(control, flight, layout)
    return place_cameras(_cameras(flight, layout))


def place_cameras(cameras: Sequence[Camera]) -> MapPlace:
    """Fit the cameras of a layout to their GPS positions."""
    positions = [camera.taken.position for camera in cameras if camera.taken.position is not None]
    if not positions:
        return MapPlace(note=f"0 of {len(cameras)} photographs have GPS")
    crs, metres = project_to_utm(positions)
    targets = np.full((len(cameras), 2), np.nan)
    targets[[camera.taken.position is not None for camera in cameras]] = metres
    names = tuple(short_names([camera.name for camera in cameras]))
    # GPS belongs to the camera, not to what is in the middle of its photograph.
    places = np.array([camera.position for camera in cameras])
    georeference, note = fit_to_map(places[:, :2], targets, crs, names)
    if georeference is None:
        return MapPlace(note=note)
    turned = _turned_deg(cameras, georeference.to_map, _true_north_deg(np.median(metres, axis=0), crs))
    if len(cameras) == 2:
        note = "two GPS positions fit exactly, so that nothing checks them"
        note += "" if turned is None else f" but the cameras' compass, which differs by {abs(turned):.0f} degrees"
    return MapPlace(
        georeference=georeference,
        fitted_to=names,
        note=note,
        height_m=float(np.median(places[:, 2])) * georeference.metres_per_pixel,
        recorded_height_m=_median([camera.taken.height_m for camera in cameras]),
        turned_deg=turned,
    )


def _fit_to_control_points(control: ControlPoints, flight: Flight, layout: Layout) -> MapPlace:
    """Fit a layout to the control points that its photographs show, each at the mean of its sightings."""
    transforms = layout.to_reference(flight.views)
    places: dict[int, list[Points]] = {}
    for member, point, pixel in _sightings(control, flight, layout):
        places.setdefault(point, []).append(apply(transforms[member], pixel))
    points = [point for point in sorted(places) if not control.checks(point)]
    if len(points) < MIN_POSITIONS:
        raise InputError(
            f"{control.name}: the mosaic shows {len(points)} of its {len(control.names)} points; "
            f"{MIN_POSITIONS} are needed: check the names of the photographs"
        )
    _check_site(control, flight, layout)
    means = {point: np.mean(each, axis=0) for point, each in places.items()}
    names = tuple(control.names[point] for point in points)
    georeference, reason = fit_to_map(
        np.array([means[point] for point in points]), control.metres[points], control.crs, names
    )
    if georeference is None:
        raise InputError(f"{control.name}: {reason}; check the coordinates and pixels")
    checked_m = {
        control.names[point]: float(np.linalg.norm(apply(georeference.to_map, mean) - control.metres[point]))
        for point, mean in means.items()
        if control.checks(point)
    }
    return MapPlace(georeference=georeference, fitted_to=names, by="control points", checked_m=checked_m)


def _sightings(control: ControlPoints, flight: Flight, layout: Layout) -> Iterator[tuple[int, int, Points]]:
    """The view, the point and the straightened pixel (2,) of each sighting in a layout's photographs."""
    find = index_names([flight.views[member].name for member in layout.members])
    for sighting in control.sightings:
        members = [layout.members[index] for index in find(sighting.photograph)]
        if len(members) > 1:
            raise InputError(f"{control.name}: {sighting.photograph} is {len(members)} photographs; add their folders")
        for member in members:
            pixel = np.array([[sighting.x_px, sighting.y_px]])
            yield member, sighting.point, flight.lens.straighten_points(pixel, flight.views[member].size)[0]


def fit_layout(flight: Flight, layout: Layout, control: ControlPoints | None = None) -> Layout:
    """Adjust a layout to ties and to control points or GPS at once; as it is where it has no place on the map.

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
    if (on_map := place.georeference) is None:
        return
    to_ground = np.asarray(np.linalg.inv(on_map.to_map @ flight.views[layout.reference].to_original), np.float64)
    px_per_m = magnification(flight.views[layout.reference].size, to_ground @ on_map.to_map) / on_map.metres_per_pixel
    if control is not None:
        scales = {m: magnification(flight.views[m].size, each) for m, each in layout.to_reference(flight.views).items()}
        for member, point, pixel in _sightings(control, flight, layout):
            if not control.checks(point):
                seen = apply(np.asarray(np.linalg.inv(flight.views[member].to_original), np.float64), pixel)
                sigma_m = np.hypot(CONTROL_M, CLICK_PX * scales[member] * on_map.metres_per_pixel)
                yield Observation(member, seen, apply(to_ground, control.metres[point]), float(sigma_m) * px_per_m)
        return
    for member, camera in zip(layout.members, _cameras(flight, layout), strict=True):
        if camera.taken.position is not None:
            metres = reproject(np.array([camera.taken.position.degrees]), "EPSG:4326", on_map.crs)[0]
            below = apply(to_ground @ on_map.to_map, camera.position[:2])
            # Without a recorded accuracy, the misfit is the best estimate of it.
            sigma_m = max(camera.taken.accuracy_m or on_map.residual_m, MIN_GPS_M)
            seen = apply(np.asarray(np.linalg.inv(layout.transforms[member]), np.float64), below)
            yield Observation(member, seen, apply(to_ground, metres), sigma_m * px_per_m)


def _check_site(control: ControlPoints, flight: Flight, layout: Layout) -> None:
    """Refuse control points far from where the photographs were taken, if that is known.

    Raises
    ------
    InputError
        With the distance; swapped axes and another site look like this.
    """
    positions = [gps for member in layout.members if (gps := flight.views[member].gps) is not None]
    if not positions:
        return
    degrees = np.array([gps.degrees for gps in positions])
    flown = np.median(reproject(degrees, "EPSG:4326", control.crs), axis=0)
    away_m = float(np.linalg.norm(np.median(control.metres, axis=0) - flown))
    if not away_m < MAX_AWAY_M:
        raise InputError(
            f"{control.name}: its points lie {away_m / 1000:.0f} km from the photographs' GPS; check the coordinate "
            "system, the order of the axes (east comes first) and the site"
        )


def camera_positions(flight: Flight, layout: Layout) -> Array:
    """Positions of the cameras of a layout's members (N, 3), see `Camera.position`."""
    return np.array([camera.position for camera in _cameras(flight, layout)])


def _cameras(flight: Flight, layout: Layout) -> list[Camera]:
    """The cameras of a layout's members, with the focal length of the camera file where there is one."""
    lens, focal = flight.settings.lens, None
    if lens.matrix is not None and lens.size is not None:
        focal = float(lens.matrix[0, 0] / (np.hypot(*lens.size) / 2))
    transforms = layout.to_reference(flight.views)
    views = [(flight.views[member], transforms[member]) for member in layout.members]
    return [Camera(view.name, view.size, transform, view.taken, focal) for view, transform in views]


def _true_north_deg(place: Points, crs: str) -> float:
    """Direction of true north on the map, clockwise: up to 3 degrees from the north of a UTM zone."""
    north = reproject(map_to_globe(place, crs) + np.array([0, 1e-3]), "EPSG:4326", crs)[0]
    return float(np.degrees(np.arctan2(*(north - place))))


def _turned_deg(cameras: Sequence[Camera], to_map: Matrix, north_deg: float) -> float | None:
    """Median clockwise turn of the photographs on the map against the yaw, from true north, that was recorded."""
    differences = []
    for camera in cameras:
        if camera.taken.yaw_deg is None:
            continue
        middle = (np.array(camera.size) - 1) / 2
        start, top = apply(to_map @ camera.to_reference, np.array([middle, middle - [0, 1]]))
        yaw_deg = np.degrees(np.arctan2(*(top - start)))
        differences.append(yaw_deg - north_deg - camera.taken.yaw_deg)
    if not differences:
        return None
    # Around their mean direction, because +178 and -179 degrees lie three degrees apart.
    mean_deg = np.degrees(np.angle(np.exp(1j * np.radians(differences)).mean()))
    return float(_shorter_turn_deg(mean_deg + np.median(_shorter_turn_deg(np.array(differences) - mean_deg))))


def _shorter_turn_deg(turn_deg: Array) -> Array:
    """The same turns the shorter way round, -180 to 180 degrees."""
    return np.asarray((turn_deg + 180) % 360 - 180)


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def north_up(georeference: Georeference, metres_per_pixel: float) -> Matrix:
    """Pixels of a georeference to pixels of a map with north up and ``metres_per_pixel``, (3, 3)."""
    to_canvas = np.diag([1 / metres_per_pixel, -1 / metres_per_pixel, 1.0]) @ georeference.to_map
    # The origin is arbitrary; small numbers keep their digits.
    to_canvas[:2, 2] -= np.round(to_canvas[:2, 2])
    return np.asarray(to_canvas)


def usual_magnification(flight: Flight, layout: Layout) -> float:
    """Pixels of the reference frame per pixel of the median photograph; 1 for two photographs.

    The reference may have flown lower or higher than most: a mosaic should neither invent detail nor lose it.
    """
    if flight.pair is not None:
        return 1.0
    transforms = layout.to_reference(flight.views)
    return float(np.median([magnification(flight.views[m].size, each) for m, each in transforms.items()]))


def scale_for(flight: Flight, layout: Layout, on_map: Georeference | None, gsd_m: float) -> float:
    """The scale at which canvas pixels are ``gsd_m`` metres wide.

    Raises
    ------
    InputError
        Without a map, or for a resolution finer than that of the photographs.
    """
    if on_map is None:
        raise InputError("gsd: the mosaic has no place on the map, so metres are unknown; use --scale instead")
    finest_m = on_map.metres_per_pixel * usual_magnification(flight, layout)
    if gsd_m < MIN_GSD * finest_m:
        raise InputError(f"gsd is {gsd_m:g} m, finer than the photographs; give at least {finest_m:.3g}")
    return min(finest_m / gsd_m, 1.0)
