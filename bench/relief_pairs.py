"""Renders pairs of views of ground with relief, for which no homography is right everywhere and the truth is known.

The landscape of `sim.scene` is laid over hills and raised blocks. Each pixel's ray is followed to the surface, so that
the true position in the other view is known for every pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.scene import Camera, CameraPose, Photometry, render_ground

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

HEIGHTS_PX = (4.0, 12.0, 25.0, 45.0)
"""Standard deviation of the relief, ground px; the camera flies at 512."""
OVERLAPS = (0.75, 0.55, 0.35, 0.2)
SIZE_PX = (640, 480)
MARGIN_PX = 400
"""Ground around both footprints, as far as tilts and relief may look."""
RAY_STEPS = 25
LANDSCAPES = 3
GRID_POINTS = 20


@dataclass(frozen=True)
class ReliefPair:
    """Two gray views, and true correspondences: left points (N, 2), each with its right point."""

    name: str
    left: Pixels
    right: Pixels
    left_points: Array
    right_points: Array


@dataclass(frozen=True)
class _Surface:
    """Ground texture and height over the ground plane, with the ground position of their first pixel."""

    texture: Pixels
    height_px: NDArray[np.float32]
    origin: Array

    def height_at(self, ground: Array) -> Array:
        """Height at ground positions (H, W, 2)."""
        x, y = np.moveaxis((ground - self.origin).astype(np.float32), -1, 0)
        return cv2.remap(self.height_px, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT).astype(np.float64)


def relief_pairs(each: int) -> Iterator[ReliefPair]:
    """``each`` pairs for every height of the relief and every overlap."""
    for height_px in HEIGHTS_PX:
        for overlap in OVERLAPS:
            for number in range(each):
                yield relief_pair(height_px, overlap, number)


def relief_pair(height_px: float, overlap: float, number: int) -> ReliefPair:
    """Pair ``number`` of a relief (standard deviation, ground px) and an overlap; the same on every run."""
    rng = np.random.default_rng([round(height_px), round(100 * overlap), number])
    width_px, height_image_px = SIZE_PX
    camera = Camera(width_px=width_px, height_px=height_image_px, focal_px=0.8 * width_px)
    heading_deg = rng.uniform(0, 360)
    heading = np.radians(heading_deg)
    shift = (1 - overlap) * width_px * np.array([np.cos(heading), np.sin(heading)])
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
    left, right = (_view(ground, surface, photometry, rng) for ground in grounds)
    rows, columns = (np.linspace(0, side - 1, GRID_POINTS).astype(int) for side in (height_image_px, width_px))
    seen = grounds[0][np.ix_(rows, columns)].reshape(-1, 2)
    left_points = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
    right_points = _project(poses[1], camera, seen, surface.height_at(seen[None])[0])
    inside = ((right_points >= 0) & (right_points <= np.array(SIZE_PX) - 1)).all(axis=1)
    name = f"relief_{height_px:g}_{round(100 * overlap)}_{number}"
    return ReliefPair(name, left, right, left_points[inside], right_points[inside])


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


def _ground_positions(pose: CameraPose, camera: Camera, surface: _Surface) -> Array:
    """Where on the ground each pixel's ray meets the surface, (H, W, 2), by fixed-point steps."""
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


def _project(pose: CameraPose, camera: Camera, ground: Array, height_px: Array) -> Array:
    """Image positions (N, 2) of surface points: ground positions (N, 2) and heights (N,)."""
    offset = np.column_stack([ground - [pose.x_px, pose.y_px], pose.altitude_px - height_px])
    mapped = offset @ pose.rotation @ camera.matrix.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def _view(ground: Array, surface: _Surface, photometry: Photometry, rng: np.random.Generator) -> Pixels:
    x, y = np.moveaxis((ground - surface.origin).astype(np.float32), -1, 0)
    gray = cv2.remap(surface.texture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return np.ascontiguousarray(photometry.apply(np.repeat(gray[..., None], 3, axis=2), rng)[..., 0])
