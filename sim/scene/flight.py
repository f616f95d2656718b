"""Flights over the synthetic landscape: pictures rendered on demand, with exact poses and homographies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import overload

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Matrix, Pixels
from sim.scene.camera import Camera, CameraPose, Photometry, find_visible_box, poses_along, project, render_view
from sim.scene.ground import render_ground, render_heights
from sim.scene.noise import Stream, make_rng
from sim.scene.terrain import render_terrain

FOCAL_WIDTHS = 0.8
"""Focal length in image widths: 64 degrees across, as on common drones."""


@dataclass(frozen=True)
class Flight:
    """A sequence of pictures of the landscape ``seed``, by one camera."""

    seed: int
    """Landscape and sensor noise; non-negative."""
    camera: Camera
    poses: tuple[CameraPose, ...]
    """One for each picture, in order of time."""
    photometries: tuple[Photometry, ...]
    """One for each picture."""
    relief: bool = False
    """Whether buildings, trees and crops stand above the ground; otherwise they are painted on it."""
    terrain: str = ""
    """What shape the land has, a key of `sim.scene.terrain.TERRAINS`; empty: flat."""

    @property
    def images(self) -> Sequence[Pixels]:
        """The pictures, (H, W, 3) uint8 BGR; each is rendered when it is read, and not kept."""
        return RenderedImages(len(self.poses), self._render)

    @property
    def homographies(self) -> tuple[Matrix, ...]:
        """Ground pixels to pixels of each picture, as a lens without distortion would have taken it."""
        return tuple(pose.homography(self.camera) for pose in self.poses)

    def homography_between(self, left: int, right: int) -> Matrix:
        """Pixels of picture ``left`` to pixels of picture ``right``, shape (3, 3), last element 1."""
        to_left = self.poses[left].homography(self.camera)
        to_right = self.poses[right].homography(self.camera)
        between: Matrix = to_right @ np.linalg.inv(to_left)
        between /= between[2, 2]
        return between

    def overlap_between(self, left: int, right: int) -> float:
        """Share of the area of picture ``left`` that is also in picture ``right``."""
        corners = self.camera.corners
        outline = project(self.homography_between(right, left), corners)
        area, _ = cv2.intersectConvexConvex(corners.astype(np.float32), outline.astype(np.float32))
        return float(area) / (self.camera.width_px * self.camera.height_px)

    def _render(self, number: int) -> Pixels:
        pose, photometry = self.poses[number], self.photometries[number]
        left, top, width_px, height_px = find_visible_box(pose, self.camera)
        ground = render_ground(self.seed, width_px, height_px, (left, top))
        rng = make_rng(self.seed, Stream.SENSOR, number)
        parts = list[Float32]()
        if self.relief:
            parts.append(render_heights(self.seed, width_px, height_px, (left, top)).astype(np.float32))
        if self.terrain:
            parts.append(render_terrain(self.terrain, width_px, height_px, (left, top)))
        heights = np.asarray(np.sum(parts, axis=0)) if parts else None
        return render_view(ground, pose, self.camera, photometry, rng, origin=(left, top), heights=heights)


class RenderedImages(Sequence[Pixels]):
    """Pictures that are rendered each time they are read, and not kept; a slice renders none.

    Parameters
    ----------
    count : int
        Number of pictures.
    render : callable
        Renders the picture of the given number, (H, W, 3) uint8 BGR.
    """

    def __init__(self, count: int, render: Callable[[int], Pixels]) -> None:
        self._count = count
        self._render = render

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Pixels: ...
    @overload
    def __getitem__(self, index: slice) -> RenderedImages: ...
    def __getitem__(self, index: int | slice) -> Pixels | RenderedImages:
        numbers = range(self._count)
        if isinstance(index, slice):
            chosen = numbers[index]
            return RenderedImages(len(chosen), lambda number: self._render(chosen[number]))
        return self._render(numbers[index])


def make_pair(seed: int, size: tuple[int, int] = (640, 480), overlap: float = 0.6) -> Flight:
    """A left and a right picture that overlap and differ by a few degrees of rotation, in scale, tilt and exposure.

    Parameters
    ----------
    seed : int
        Landscape, poses and noise; non-negative.
    size : (int, int)
        Width and height of the pictures; one of their pixels is about one ground pixel (0.15 m).
    overlap : float
        Share of the left picture that is also in the right one, 0..1; rotation and scale change it by up to 0.07.
    """
    _check_overlap("overlap", overlap)
    rng = make_rng(seed, Stream.PAIR)
    camera = Camera(width_px=size[0], height_px=size[1], focal_px=FOCAL_WIDTHS * size[0])
    heading, turn = rng.uniform(0, 360), rng.choice([-1, 1]) * rng.uniform(3, 8)
    away = (1 - overlap) * size[0] * np.array([np.cos(np.radians(heading)), np.sin(np.radians(heading))])
    start = rng.uniform(-500, 500, 2)
    poses = [
        _aim_at(start, camera.focal_px, heading, rng),
        _aim_at(start + away, camera.focal_px * rng.uniform(0.97, 1.05), heading + turn, rng),
    ]
    left = Photometry(blur_sigma_px=0.4, noise_sigma=1.5, vignetting=0.1)
    right = Photometry(
        gain=rng.uniform(0.8, 0.95), gamma=rng.uniform(1.02, 1.15), blur_sigma_px=0.5, noise_sigma=2.0, vignetting=0.1
    )
    return Flight(seed, camera, tuple(poses), (left, right))


def _aim_at(target: Array, altitude_px: float, heading_deg: float, rng: np.random.Generator) -> CameraPose:
    """A pose, tilted by up to 2 degrees, with ``target`` at the image centre."""
    pitch, roll = rng.uniform(-2, 2, 2)
    pose = CameraPose(x_px=0, y_px=0, altitude_px=altitude_px, heading_deg=heading_deg, pitch_deg=pitch, roll_deg=roll)
    axis = pose.rotation[:, 2]
    x, y = (target - axis[:2] / axis[2] * altitude_px).tolist()
    return replace(pose, x_px=x, y_px=y)


def make_lawnmower(
    seed: int,
    images: int,
    size: tuple[int, int] = (1600, 1200),
    forward_overlap: float = 0.75,
    side_overlap: float = 0.6,
    *,
    k1: float = 0.0,
    vignetting: float = 0.1,
    exposure_step: float = 0.02,
    balance_sigma: float = 0.0,
    relief: bool = False,
    terrain: str = "",
) -> Flight:
    """A survey in parallel legs over a roughly square area, turning round at the end of each leg.

    Position, heading, altitude, tilt and exposure vary a little, as those of a drone do. Pictures are rendered on
    demand; memory is bounded by one picture and the cached tiles of `sim.scene.ground` (240 MiB), whatever the length.

    Parameters
    ----------
    seed : int
        Landscape, poses and noise; non-negative.
    images : int
        Number of pictures, at least 1.
    size : (int, int)
        Width and height of the pictures; one of their pixels is about one ground pixel (0.15 m).
    forward_overlap, side_overlap : float
        Overlap of successive pictures of a leg, and of neighbouring legs, 0..1; the variation above changes both.
    k1, vignetting : float
        Properties of the lens, see `Camera` and `Photometry`.
    exposure_step : float
        Standard deviation of the change of the gain from one picture to the next.
    balance_sigma : float
        Standard deviation of the gain of each channel.
    relief : bool
    terrain : str
        See `Flight`.
    """
    _check_overlap("forward_overlap", forward_overlap)
    _check_overlap("side_overlap", side_overlap)
    if images < 1:
        raise ValueError(f"images is {images}; a flight has at least 1")
    rng = make_rng(seed, Stream.LAWNMOWER)
    camera = Camera(width_px=size[0], height_px=size[1], focal_px=FOCAL_WIDTHS * size[0], k1=k1)
    side_px, forward_px = (1 - side_overlap) * size[0], (1 - forward_overlap) * size[1]
    leg_images = max(1, round(np.sqrt(images * side_px / forward_px)))
    leg, along = np.divmod(np.arange(images), leg_images)
    backwards = leg % 2
    row = np.where(backwards, leg_images - 1 - along, along)
    poses = poses_along(
        x_px=leg * side_px + rng.normal(0, 0.01 * size[0], images),
        y_px=-row * forward_px + rng.normal(0, 0.01 * size[1], images),
        altitude_px=camera.focal_px * rng.normal(1, 0.01, images),
        heading_deg=180 * backwards + rng.normal(0, 1.5, images),
        pitch_deg=rng.normal(0, 0.8, images),
        roll_deg=rng.normal(0, 0.8, images),
    )
    gains = np.clip(1 + np.cumsum(rng.normal(0, exposure_step, images)), 0.85, 1.15).tolist()
    balances = (1 + balance_sigma * rng.standard_normal((images, 3))).tolist()
    photometries = [
        Photometry(gain=gain, blur_sigma_px=0.4, noise_sigma=1.5, vignetting=vignetting, balance=tuple(balance))
        for gain, balance in zip(gains, balances, strict=True)
    ]
    return Flight(seed, camera, poses, tuple(photometries), relief, terrain)


def _check_overlap(name: str, share: float) -> None:
    if not 0 <= share < 1:
        raise ValueError(f"{name} is {share}; it must be at least 0 and less than 1")
