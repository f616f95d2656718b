"""Short rendered videos of an object whose outline is known in every frame."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from bench.nuisances import haze
from golden_model.arrays import Array, Pixels
from sim.scene import Camera, CameraPose, Flight, Photometry, make_pursuit, render_ground
from sim.scene.flight import FOCAL_WIDTHS
from skymosaic.geometry.homography import apply
from skymosaic.tracking.template import Roi

FRAMES, SIZE_PX, MAGNIFICATION = 40, (480, 360), 2.0
CAMERA = Camera(width_px=SIZE_PX[0], height_px=SIZE_PX[1], focal_px=FOCAL_WIDTHS * SIZE_PX[0])
ALTITUDE_PX = CAMERA.focal_px / MAGNIFICATION
PLANE = Roi(190, 140, 100, 80)
"""The piece of ground that is followed, and the place of the object that turns."""
STEP_PX = 2.5
"""How far the object that turns moves from one frame to the next."""
Way = Callable[[float], float]


@dataclass(frozen=True)
class TrackingVideo:
    """Frames, (H, W, 3) uint8 BGR, and where the rectangle ``roi`` of the first one really is.

    ``corners`` (N, 4, 2) are clockwise from its top left; ``hidden`` (N,) is the share of it that something hides.
    """

    frames: list[Pixels]
    roi: Roi
    corners: Array
    hidden: Array

    @property
    def visible(self) -> Array:
        """Share of the object that is seen in each frame, (N,), 0..1."""
        frame, corners = outline(Roi(0, 0, *SIZE_PX)).astype(np.float32), self.corners.astype(np.float32)
        inside = [cv2.intersectConvexConvex(each, frame)[0] / cv2.contourArea(each) for each in corners]
        return np.array(inside) * (1 - self.hidden)


def outline(roi: Roi) -> Array:
    """Outer corners (4, 2) of a rectangle, clockwise from its top left."""
    return np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * roi[2:] + roi[:2] - 0.5


def watch_ground(seed: int, light: Callable[[float], Photometry] | None = None, **ways: Way) -> TrackingVideo:
    """A piece of flat ground; fields of the camera's pose, and its light, are functions of time, 0..1."""
    times = np.linspace(0, 1, FRAMES).tolist()
    usual = {"x_px": 300.0, "y_px": 300.0, "altitude_px": ALTITUDE_PX}
    poses = tuple(CameraPose(**usual | {name: way(time) for name, way in ways.items()}) for time in times)
    lights = tuple(replace(light(time) if light else Photometry(), noise_sigma=2.0) for time in times)
    flight = Flight(seed, CAMERA, poses, lights)
    corners = [apply(flight.homography_between(0, number), outline(PLANE)) for number in range(FRAMES)]
    return TrackingVideo(list(flight.images), PLANE, np.stack(corners), np.zeros(FRAMES))


def pursue_car(seed: int, *, loose: float = 1.0, bridge: bool = False) -> TrackingVideo:
    """A car from above, in a rectangle ``loose`` times as wide and as high as its own."""
    film = make_pursuit(seed, FRAMES, SIZE_PX, magnification=MAGNIFICATION, bridge=bridge)
    first, last = film.corners[0].min(axis=0), film.corners[0].max(axis=0)
    roi = Roi(*np.rint([*((first + last) - loose * (last - first)) / 2, *loose * (last - first)]).astype(int).tolist())
    to_car = np.linalg.inv(film.car_to_images[0])
    corners = [apply(to_image @ to_car, outline(roi)) for to_image in film.car_to_images]
    return TrackingVideo(list(film.images), roi, np.stack(corners), 1 - film.visible)


def show_another_side(seed: int) -> TrackingVideo:
    """An object that moves over the ground, and slowly changes its look."""
    video = watch_ground(seed)
    first, last = (render_ground(seed + number, PLANE.width_px, PLANE.height_px) for number in (1, 2))
    for number, frame in enumerate(video.frames):
        x, share = PLANE.x_px + round(STEP_PX * number), min(max(1.5 * number / FRAMES - 0.25, 0), 1)
        mixed = cv2.addWeighted(first, 1 - share, last, share, 0)
        frame[PLANE.y_px : PLANE.y_px + PLANE.height_px, x : x + PLANE.width_px] = mixed
        video.corners[number] += (x - PLANE.x_px, 0)
    return video


def write_over(video: TrackingVideo, place: int) -> TrackingVideo:
    """A line of text that stands still in the frames, where the object is in frame ``place``."""
    x, y = np.rint(np.add(video.corners[place].mean(axis=0), (-70, 5))).astype(int).tolist()
    for number, frame in enumerate(video.frames):
        text = f"ALT 120.{number // 10} m SPD 12"
        cv2.putText(frame, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return video


def _wave(middle: float, swing: float, pace: float) -> Way:
    return lambda time: middle + swing * math.sin(pace * time)


drift = _wave(300, 40, 1)
VIDEOS: dict[str, Callable[[int], TrackingVideo]] = {
    "plane: scale": partial(watch_ground, altitude_px=_wave(ALTITUDE_PX, 0.6 * ALTITUDE_PX, 5)),
    "plane: rotation": partial(watch_ground, heading_deg=lambda time: 150 * time),
    "plane: perspective": partial(watch_ground, pitch_deg=_wave(0, 25, 3), roll_deg=_wave(0, 12, 5)),
    "plane: blur": partial(watch_ground, light=lambda time: Photometry(blur_sigma_px=4 * time), x_px=drift),
    "plane: light": partial(watch_ground, light=lambda time: Photometry(gain=_wave(1, 0.8, 9)(time)), x_px=drift),
    "plane: haze": lambda seed: replace(
        plain := watch_ground(seed, x_px=drift), frames=[haze(frame, 0, 0.15) for frame in plain.frames]
    ),
    "out of view and back": partial(watch_ground, x_px=_wave(300, 280, math.pi)),
    "car": pursue_car,
    "car in a box of four times its area": partial(pursue_car, loose=2.0),
    "car that passes below text": lambda seed: write_over(pursue_car(seed), FRAMES // 3),
    "car below text in the first frame": lambda seed: write_over(pursue_car(seed), 0),
    "car hidden by a bridge": partial(pursue_car, bridge=True),
    "object that shows another side": show_another_side,
}
