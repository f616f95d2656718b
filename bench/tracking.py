"""An object followed through rendered videos whose truth is known, beside other trackers.

    python -m bench.tracking [--seeds 3]

A cell has the share of frames, in percent, in which the outline has an IoU of more than 0.5 with the true one, of those
that show all of the object; and in brackets the number of frames with an outline in a wrong place: it has nothing in
common with the true one, or the object is not seen. KLT follows corners from frame to frame, and moves the outline by a
similarity; SIFT finds the rectangle of the first frame by MAGSAC. Both need 8 inliers.
"""

import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.progress import track

from bench.peers import TOLERANCE_PX, match_words, sift_words
from bench.report import JsonFile, Row, report
from bench.tracking_videos import FRAMES, VIDEOS, TrackingVideo, outline
from golden_model.arrays import Array, Mask, Pixels
from skymosaic.geometry.homography import apply
from skymosaic.tracking.template import Roi
from skymosaic.tracking.tracker import Tracker

FEATURES, MIN_INLIERS = 4000, 8
Outlines = Iterator[Array | None]
"""The outline (4, 2) in each frame; None where the object is lost."""


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


def follow_by_flow(video: TrackingVideo) -> Outlines:
    """Lucas and Kanade's tracker; as in most programs, nothing finds an object that was lost."""
    corners: Array | None = outline(video.roi)
    yield corners
    for before, now in pairwise(map(_gray, video.frames)):
        corners = None if corners is None else _flow(before, now, corners)
        yield corners


def _flow(before: Pixels, now: Pixels, corners: Array) -> Array | None:
    """The outline ``corners`` (4, 2) in the next frame."""
    mask = cv2.fillConvexPoly(np.zeros_like(before), np.rint(corners).astype(np.int32), 255)
    start = cv2.goodFeaturesToTrack(before, 200, 0.01, 4, mask=mask)
    if start is None:
        return None
    there, arrives, _ = cv2.calcOpticalFlowPyrLK(before, now, start, None)
    back, returns, _ = cv2.calcOpticalFlowPyrLK(now, before, there, None)
    kept = (arrives & returns).ravel().astype(bool) & (np.linalg.norm(back - start, axis=2).ravel() < 1)
    if kept.sum() < MIN_INLIERS:
        return None
    matrix, inliers = cv2.estimateAffinePartial2D(start[kept], there[kept], ransacReprojThreshold=TOLERANCE_PX)
    return cv2.transform(corners[None], matrix)[0] if inliers.sum() >= MIN_INLIERS else None


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
    "KLT": follow_by_flow,
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


def main(
    seeds: Annotated[int, typer.Option(min=1, help="Videos of each kind.")] = 3, json_file: JsonFile = None
) -> None:
    """Print a row for each kind of video, and the frames per second of processor time."""
    rows: list[Row] = []
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
        rows.append(row)
    frames = FRAMES * seeds * len(VIDEOS)
    rows.append({"video": "frames per second", **{name: f"{frames / seconds[name]:.0f}" for name in TRACKERS}})
    report("tracking", rows, json_file)


if __name__ == "__main__":
    typer.run(main)
