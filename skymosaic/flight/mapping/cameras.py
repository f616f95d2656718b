"""The cameras above the photographs of a layout: where they are, and how they are turned."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from golden_model.arrays import Array, Matrix, Points
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.layout.motions import FOCAL_HALF_DIAGONALS
from skymosaic.geometry.homography import apply
from skymosaic.imagery.exif import Metadata
from skymosaic.maps.georeference import map_to_globe, reproject


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera above its photograph."""

    name: str
    """Name of the photograph."""
    size: tuple[int, int]
    """Width and height, px."""
    to_reference: Matrix
    """(3, 3): its pixels to the reference frame of the layout."""
    taken: Metadata
    """What the camera recorded."""
    focal_half_diagonals: float | None = None
    """Focal length, half diagonals of the photograph; None: as recorded, else that of common drones."""
    centre_px: Array | None = None
    """The principal point; None: the middle."""

    @cached_property
    def position(self) -> Array:
        """x and y in the reference frame, and height above it (3,), px.

        A camera that leans sees ground beside the place below it: at a height of 100 m, one degree makes 1.7 m. The
        position follows from the homography, as for a calibrated camera over a plane (Zhang 2000, section 3.1).
        """
        width, height = self.size
        focal = self.focal_half_diagonals or self.taken.focal_half_diagonals or FOCAL_HALF_DIAGONALS
        focal_px = focal * float(np.hypot(width, height)) / 2
        x, y = (np.array(self.size) - 1) / 2 if self.centre_px is None else self.centre_px
        camera = np.array([[focal_px, 0, x], [0, focal_px, y], [0, 0, 1]])
        pose = np.linalg.inv(self.to_reference @ camera)
        pose /= (np.linalg.norm(pose[:, 0]) + np.linalg.norm(pose[:, 1])) / 2
        # The nearest rotation: noise, and ground that is not quite flat, leave the columns not quite orthogonal.
        left, _, right = np.linalg.svd(np.column_stack((pose[:, 0], pose[:, 1], np.cross(pose[:, 0], pose[:, 1]))))
        x, y, z = -(left @ right).T @ pose[:, 2]
        return np.array([x, y, abs(z)])


def cameras_of(flight: Flight, layout: Layout) -> list[Camera]:
    """The cameras of a layout's members, with the focal length of the camera file, and the lens's centre, if known."""
    transforms = layout.to_reference(flight.views)
    cameras = []
    for member in layout.members:
        view, focal, centre = flight.views[member], None, None
        if (known := flight.lens.turned(view.orientation).camera_at(view.size)) is not None:
            centre = known[0][:2, 2]
            # That of an estimated lens is only what its coefficients refer to.
            if flight.settings.lens.matrix is not None:
                focal = float(known[0][0, 0] / (np.hypot(*view.size) / 2))
        cameras.append(Camera(flight.short_names[view.name], view.size, transforms[member], view.taken, focal, centre))
    return cameras


def measure_turn(cameras: Sequence[Camera], to_map: Matrix, place: Points, crs: str) -> float | None:
    """Median clockwise turn of the photographs on the map against the recorded yaw, from true north, degrees.

    ``to_map`` takes the reference frame of their layout to metres. ``place`` (2,) is where they are, m: there, true
    north is up to 3 degrees from the north of a UTM zone.
    """
    north = reproject(map_to_globe(place, crs) + np.array([0, 1e-3]), "EPSG:4326", crs)[0]
    north_deg = np.degrees(np.arctan2(*(north - place)))
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
