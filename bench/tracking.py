"""An object followed through rendered videos whose truth is known, beside other trackers.

    python -m bench.tracking [--seeds 3]

A cell has the share of frames, in percent, in which the outline has an IoU of more than 0.5 with the true one, of those
that show all of the object; and in brackets the number of frames with an outline in a wrong place: it has nothing in
common with the true one, or the object is not seen. SIFT finds the rectangle of the first frame by MAGSAC, and needs 8
inliers.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.progress import track

from bench.methods import TOLERANCE_PX, match_words, sift_words
from bench.nuisances import haze
from bench.report import Row, reported
from golden_model.arrays import Array, Mask, Pixels
from sim.scene import Camera, CameraPose, Flight, Photometry, make_pursuit, render_ground
from sim.scene.flight import FOCAL_WIDTHS
from skymosaic.geometry.homography import apply
from skymosaic.tracking.template import Roi
from skymosaic.tracking.tracker import Tracker

FRAMES, SIZE_PX, MAGNIFICATION = 40, (480, 360), 2.0
CAMERA = Camera(width_px=SIZE_PX[0], height_px=SIZE_PX[1], focal_px=FOCAL_WIDTHS * SIZE_PX[0])
ALTITUDE_PX = CAMERA.focal_px / MAGNIFICATION
PLANE = Roi(190, 140, 100, 80)
"""The piece of ground that is followed, and the place of the object that turns."""
STEP_PX = 2.5
"""How far the object that turns moves from one frame to the next."""
Way = Callable[[float], float]
FEATURES, MIN_INLIERS = 4000, 8
Outlines = Iterator[Array | None]
"""The outline (4, 2) in each frame; None where the object is lost."""


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


def follow(video: TrackingVideo) -> Outlines:
    """This project's tracker."""
    with Tracker(video.roi) as tracker:
        yield from (tracker.follow(frame).corners for frame in video.frames)


def follow_by_filter(create: Callable[[], cv2.Tracker], video: TrackingVideo) -> Outlines:
    """One of OpenCV's trackers, whose outlines are upright rectangles."""
    tracker = create()
    tracker.init(video.frames[0], tuple(video.roi))
    yield outline(video.roi)
    for frame in video.frames[1:]:
        found, box = tracker.update(frame)
        yield outline(Roi(*box)) if found else None


def follow_by_sift(video: TrackingVideo) -> Outlines:
    """SIFT's features in the rectangle of the first frame, and a homography to each frame."""
    points, words = sift_words(_gray(video.frames[0]), FEATURES)
    inside = (np.abs(points - outline(video.roi).mean(axis=0)) < np.array(video.roi[2:]) / 2).all(axis=1)
    for frame in video.frames:
        left, right = match_words((points[inside], words[inside]), sift_words(_gray(frame), FEATURES))
        H, inliers = None, np.zeros(0)
        if len(left) >= MIN_INLIERS:
            H, inliers = cv2.findHomography(left, right, cv2.USAC_MAGSAC, TOLERANCE_PX, maxIters=10_000)
        yield None if H is None or inliers.sum() < MIN_INLIERS else apply(H, outline(video.roi))


def _gray(frame: Pixels) -> Pixels:
    return np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))


TRACKERS: dict[str, Callable[[TrackingVideo], Outlines]] = {
    "skymosaic": follow,
    "CSRT": lambda video: follow_by_filter(cv2.TrackerCSRT.create, video),
    "KCF": lambda video: follow_by_filter(cv2.TrackerKCF.create, video),
    "SIFT": follow_by_sift,
}


def measure(video: TrackingVideo, found: list[Array | None]) -> tuple[Mask, Mask]:
    """Whether each outline is right, for frames that show the whole object, (N,); whether each is wrong, (M,)."""
    shared = np.array(
        [0 if each is None else _iou(each, true) for each, true in zip(found, video.corners, strict=True)]
    )
    is_found = np.array([each is not None for each in found])
    return shared[video.visible > 0.999] > 0.5, is_found & ((shared == 0) | (video.visible < 0.05))


def _iou(first: Array, second: Array) -> float:
    one, other = first.astype(np.float32), second.astype(np.float32)
    shared = cv2.intersectConvexConvex(one, other)[0] if cv2.isContourConvex(one) else 0.0
    return float(shared / (cv2.contourArea(one) + cv2.contourArea(other) - shared))


@reported("tracking")
def main(seeds: Annotated[int, typer.Option(min=1, help="Videos of each kind.")] = 3) -> Iterator[Row]:
    """Print a row for each kind of video, and the frames per second of processor time."""
    seconds = dict.fromkeys(TRACKERS, 0.0)
    for kind, render in track(VIDEOS.items(), "tracking", transient=True):
        videos = [render(seed) for seed in range(1, 1 + seeds)]
        row: Row = {"video": kind}
        for name, tracker in TRACKERS.items():
            start = time.process_time()
            found = [list(tracker(video)) for video in videos]
            seconds[name] += time.process_time() - start
            right, wrong = map(np.concatenate, zip(*map(measure, videos, found), strict=True))
            row[name] = f"{100 * right.mean():.0f} ({wrong.sum()})"
        yield row
    frames = FRAMES * seeds * len(VIDEOS)
    yield {"video": "frames per second", **{name: f"{frames / seconds[name]:.0f}" for name in TRACKERS}}


if __name__ == "__main__":
    typer.run(main)
