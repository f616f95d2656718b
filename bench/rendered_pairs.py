"""Renders pairs of views whose true geometry is known, hard ones over flat ground and ground with relief; writes sets.

``zoom_3`` shows the same place from three times the height, at any heading; ``tilt_60`` looks at it from 60 degrees off
the vertical, at any heading and from any side. The nearer view has one pixel for each ground pixel, so no view shows
less detail than a camera would. In ``horizon_80`` both look 50 degrees off the vertical, 80 degrees apart, so that one
shows ground behind the other camera. ``overlap_15`` shares 15 % of the width; ``small_55`` shares 55 % at 240x180 px,
turned, blurred and compressed; ``dark_3`` shares 55 % at an eighth of the light, blurred, with noise of 3 gray levels.

Of pairs with relief no homography is right everywhere: the landscape lies over hills and raised blocks. Each pixel's
ray is followed to the surface, which gives its true position in the other view.
"""

import csv
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Matrix, Pixels, Points
from sim.scene import Camera, CameraPose, Photometry, render_ground, render_view
from sim.scene.camera import find_visible_box
from sim.scene.flight import FOCAL_WIDTHS
from skymosaic.evaluation.known_pairs import COLUMNS, LIST_NAME
from skymosaic.imagery.images import save

STEPS = {
    "zoom": (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0),
    "tilt": (20, 30, 40, 50, 60, 65, 70, 75),
    "horizon": (60, 70, 80),
    "overlap": (25, 20, 15, 10),
    "small": (55, 35, 25),
    "dark": (2, 3, 4),
}
"""Factors of height, degrees, percent of the width, and gray levels of noise."""
TILTED_FOCAL_WIDTHS = {60: 1.6, 75: 3.2}
"""Of tilts up to so many degrees: a wider view would show the horizon."""
HEIGHTS_PX = (4.0, 12.0, 25.0, 45.0)
"""Standard deviation of the relief, ground px; the camera flies at 512."""
OVERLAPS = (0.75, 0.55, 0.35, 0.2)
SIZE_PX = (640, 480)
SMALL_PX = (240, 180)
JPEG_QUALITY = 35
"""Of small views."""
SIDEWAYS_DEG = 50
DARK = 1 / 8
DARK_SHARE = 0.55
OVERSAMPLING = 2
"""Views are rendered larger and reduced by area, as a tilted pixel averages more ground in one direction."""
LANDSCAPES = 3
"""Seeds of the landscapes that all pairs come from; their tiles are cached."""
MARGIN_PX = 400
"""Ground rendered around both views' centres, about as far as their rays reach."""
RAY_STEPS = 25
GRID_POINTS = 20

Ground = Array
"""Ground positions of each pixel, (H, W, 2)."""


def write_set(folder: Path, pairs: Iterable[tuple[str, str, Pixels, Pixels, Matrix]]) -> None:
    """Write pairs (name, group, left, right, homography from left to right) as a folder that `read_pairs` reads."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    with (folder / LIST_NAME).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for name, group, *images, truth in pairs:
            paths = [f"images/{name}_{side}.png" for side in ("left", "right")]
            for path, image in zip(paths, images, strict=True):
                save(folder / path, image)
            writer.writerow([name, group, *paths, *(truth / truth[2, 2]).ravel().tolist()])


def flat_pairs(kind: str, each: int) -> Iterator[tuple[str, str, Pixels, Pixels, Matrix]]:
    """Render ``each`` pairs for every step of a kind: name, group, left and right view, true homography."""
    for step, number in itertools.product(STEPS[kind], range(each)):
        group = f"{kind}_{step:g}"
        yield f"{group}_{number:02d}", group, *flat_pair(kind, step, number)


def flat_pair(kind: str, step: float, number: int) -> tuple[Pixels, Pixels, Matrix]:
    """Render pair ``number`` of a kind and one of its `STEPS`; the same on every run."""
    rng = np.random.default_rng([list(STEPS).index(kind), round(10 * step), number])
    steepest = next((limit for limit in TILTED_FOCAL_WIDTHS if kind == "tilt" and step <= limit), None)
    focal_widths = TILTED_FOCAL_WIDTHS[steepest] if steepest else FOCAL_WIDTHS
    camera = _camera(focal_widths, SMALL_PX if kind == "small" else SIZE_PX)
    near, far = _poses(kind, step, camera, rng)
    poses = [near, far] if number % 2 else [far, near]
    photometries = [
        Photometry(blur_sigma_px=0.4, noise_sigma=1.5, vignetting=0.1),
        Photometry(gain=rng.uniform(0.8, 0.95), gamma=rng.uniform(1, 1.15), noise_sigma=2.0, vignetting=0.1),
    ]
    if kind == "dark":
        photometries = [replace(p, gain=DARK * p.gain, blur_sigma_px=1.0, noise_sigma=step) for p in photometries]
    if kind == "small":
        photometries = [replace(p, blur_sigma_px=0.8) for p in photometries]
    left, right = (
        _flat_view(number % LANDSCAPES, pose, camera, photometry, rng)
        for pose, photometry in zip(poses, photometries, strict=True)
    )
    if kind == "small":
        left, right = _compress(left), _compress(right)
    to_left, to_right = (pose.homography(camera) for pose in poses)
    return left, right, to_right @ np.linalg.inv(to_left)


def _poses(kind: str, step: float, camera: Camera, rng: np.random.Generator) -> tuple[CameraPose, CameraPose]:
    """The poses of a pair, the nearer one first where they differ."""
    centre = rng.uniform(-300, 300, 2)
    heading_deg, turn_deg = rng.uniform(0, 360), rng.uniform(-180, 180)
    # The centre of the other view is up to a tenth of the width away.
    other = centre + rng.uniform(-0.1, 0.1, 2) * camera.width_px
    near = CameraPose(x_px=centre[0], y_px=centre[1], altitude_px=camera.focal_px, heading_deg=heading_deg)
    if kind == "zoom":
        far = replace(near, x_px=other[0], y_px=other[1], altitude_px=camera.focal_px * step)
    elif kind == "tilt":
        # The distance along the optical axis stays the same, and with it the scale in the middle.
        pose = replace(near, x_px=0, y_px=0, altitude_px=camera.focal_px * np.cos(np.radians(step)), pitch_deg=step)
        axis = replace(pose, heading_deg=heading_deg + turn_deg).rotation[:, 2]
        ground = other - axis[:2] / axis[2] * pose.altitude_px
        far = replace(pose, x_px=ground[0], y_px=ground[1])
    elif kind == "horizon":
        altitude_px = camera.focal_px * np.cos(np.radians(SIDEWAYS_DEG))
        near = replace(near, altitude_px=altitude_px, pitch_deg=SIDEWAYS_DEG)
        far = replace(near, x_px=other[0], y_px=other[1])
        turn_deg = np.copysign(step, turn_deg)
    else:
        share = step / 100 if kind in ("overlap", "small") else DARK_SHARE
        across = np.radians(heading_deg)
        shifted = centre + (1 - share) * camera.width_px * np.array([np.cos(across), np.sin(across)])
        altitude_px = camera.focal_px * rng.uniform(1, 1.1)
        tilts = dict(zip(("pitch_deg", "roll_deg"), rng.uniform(-3, 3, 2), strict=True))
        far = replace(near, x_px=shifted[0], y_px=shifted[1], altitude_px=altitude_px, **tilts)
        turn_deg = turn_deg if kind == "small" else turn_deg / 12
    return near, replace(far, heading_deg=heading_deg + turn_deg)


def _compress(view: Pixels) -> Pixels:
    jpeg = cv2.imencode(".jpg", view, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def _flat_view(
    landscape: int, pose: CameraPose, camera: Camera, photometry: Photometry, rng: np.random.Generator
) -> Pixels:
    large = Camera(**{name: value * OVERSAMPLING for name, value in vars(camera).items()})
    left, top, width_px, height_px = find_visible_box(pose, large)
    ground = render_ground(landscape, width_px, height_px, (left, top))
    view = render_view(ground, pose, large, Photometry(), rng, origin=(left, top))
    reduced = cv2.resize(view, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(photometry.apply(np.asarray(reduced, np.uint8), rng), cv2.COLOR_BGR2GRAY)


def _camera(focal_widths: float, size_px: tuple[int, int] = SIZE_PX) -> Camera:
    width_px, height_px = size_px
    return Camera(width_px=width_px, height_px=height_px, focal_px=focal_widths * width_px)


@dataclass(frozen=True)
class ReliefPair:
    """Two gray views, and true correspondences: left points (N, 2), each with its right point."""

    left: Pixels
    right: Pixels
    left_points: Points
    right_points: Points


@dataclass(frozen=True)
class _Surface:
    """Ground texture and height over the ground plane, with the ground position of their first pixel."""

    texture: Pixels
    height_px: Float32
    origin: Array

    def height_at(self, ground: Ground) -> Array:
        """Height at ground positions (H, W, 2)."""
        x, y = np.moveaxis((ground - self.origin).astype(np.float32), -1, 0)
        return cv2.remap(self.height_px, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT).astype(np.float64)


def relief_pairs(each: int) -> Iterator[ReliefPair]:
    """Render ``each`` pairs for every height of the relief and every overlap."""
    for height_px, overlap, number in itertools.product(HEIGHTS_PX, OVERLAPS, range(each)):
        yield relief_pair(height_px, overlap, number)


def relief_pair(height_px: float, overlap: float, number: int) -> ReliefPair:
    """Render pair ``number`` of a relief (standard deviation, ground px) and an overlap; the same on every run."""
    rng = np.random.default_rng([round(height_px), round(100 * overlap), number])
    camera = _camera(FOCAL_WIDTHS)
    heading_deg = rng.uniform(0, 360)
    heading = np.radians(heading_deg)
    shift = (1 - overlap) * camera.width_px * np.array([np.cos(heading), np.sin(heading)])
    centre = rng.uniform(-300, 300, 2)
    poses = [
        CameraPose(
            x_px=position[0],
            y_px=position[1],
            altitude_px=camera.focal_px * rng.uniform(0.95, 1.1),
            heading_deg=heading_deg + turn_deg,
            pitch_deg=rng.uniform(-3, 3),
            roll_deg=rng.uniform(-3, 3),
        )
        for position, turn_deg in ((centre, 0.0), (centre + shift, rng.uniform(-15, 15)))
    ]
    surface = _surface(number % LANDSCAPES, centre, centre + shift, height_px, rng)
    photometry = Photometry(gain=rng.uniform(0.85, 1), blur_sigma_px=0.4, noise_sigma=2.0, vignetting=0.1)
    grounds = [_ground_positions(pose, camera, surface) for pose in poses]
    left, right = (_relief_view(ground, surface, photometry, rng) for ground in grounds)
    rows, columns = (np.linspace(0, side - 1, GRID_POINTS).astype(int) for side in left.shape)
    visible = grounds[0][np.ix_(rows, columns)].reshape(-1, 2)
    left_points = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
    right_points = _project(poses[1], camera, visible, surface.height_at(visible[None])[0])
    inside = ((right_points >= 0) & (right_points <= np.array(SIZE_PX) - 1)).all(axis=1)
    return ReliefPair(left, right, left_points[inside], right_points[inside])


def _surface(landscape: int, one: Array, other: Array, height_px: float, rng: np.random.Generator) -> _Surface:
    low = np.floor(np.minimum(one, other)).astype(int) - MARGIN_PX
    width, height = (np.ceil(np.maximum(one, other)).astype(int) + MARGIN_PX - low).tolist()
    texture = cv2.cvtColor(render_ground(landscape, width, height, (int(low[0]), int(low[1]))), cv2.COLOR_BGR2GRAY)
    hills = cv2.GaussianBlur(rng.standard_normal((height, width)).astype(np.float32), (0, 0), rng.uniform(50, 140))
    hills /= hills.std()
    blocks = np.zeros_like(hills)
    for _ in range(int(rng.integers(4, 14))):
        x, y = rng.integers(0, width), rng.integers(0, height)
        side = rng.integers(30, 110, 2)
        blocks[y : y + side[1], x : x + side[0]] = rng.uniform(1, 2.5)
    # Slopes steeper than the rays would hide ground; soft walls keep the map between the views one to one.
    relief = hills + rng.uniform(0, 0.8) * cv2.GaussianBlur(blocks, (0, 0), 12)
    return _Surface(texture, (height_px * relief).astype(np.float32), low.astype(np.float64))


def _ground_positions(pose: CameraPose, camera: Camera, surface: _Surface) -> Ground:
    """Find the ground position where each pixel's ray meets the surface, by fixed-point steps."""
    y, x = np.mgrid[: camera.height_px, : camera.width_px]
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1).astype(np.float64)
    rays = pixels @ np.linalg.inv(camera.matrix).T @ pose.rotation.T
    slope = rays[..., :2] / rays[..., 2:]
    position = np.array([pose.x_px, pose.y_px])
    ground = position + slope * pose.altitude_px
    for _ in range(RAY_STEPS):
        height = surface.height_at(ground)
        ground = ground + 0.7 * (position + slope * (pose.altitude_px - height)[..., None] - ground)
    return ground


def _project(pose: CameraPose, camera: Camera, ground: Points, height_px: Array) -> Points:
    """Project surface points, given by ground positions (N, 2) and heights (N,), to image positions (N, 2)."""
    offset = np.column_stack([ground - [pose.x_px, pose.y_px], pose.altitude_px - height_px])
    mapped = offset @ pose.rotation @ camera.matrix.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def _relief_view(ground: Ground, surface: _Surface, photometry: Photometry, rng: np.random.Generator) -> Pixels:
    x, y = np.moveaxis((ground - surface.origin).astype(np.float32), -1, 0)
    gray = cv2.remap(surface.texture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return np.ascontiguousarray(photometry.apply(np.repeat(gray[..., None], 3, axis=2), rng)[..., 0])
