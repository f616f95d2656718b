"""Key points by every detector: the front end's Harris and FAST, SURF's box filters, and OpenCV's detectors.

The thresholds are low enough for thousands of key points per photograph; callers keep the strongest.
"""

from collections.abc import Callable, Sequence
from typing import Literal, get_args

import cv2
import numpy as np

from golden_model.arrays import Float32, Pixels, Records
from golden_model.feature.orientation import SECTORS
from golden_model.formats import POSITION, decode_response
from skymosaic.features import surf

KeyPoints = Sequence[cv2.KeyPoint]

Detector = Literal["harris", "fast", "surf", "sift", "orb", "akaze", "brisk", "klt"]
DETECTORS: tuple[Detector, ...] = get_args(Detector)
FRONT_END_DETECTORS = ("harris", "fast")
CORNER_SIZE_PX = 7.0
"""Diameter of Harris and FAST corners, which have no scale: OpenCV's value for its FAST corners."""

_OPENCV: dict[str, Callable[[int], cv2.Feature2D]] = {
    # No limit: SIFT counts every orientation at a position towards nfeatures.
    "sift": lambda _: cv2.SIFT.create(nfeatures=0, contrastThreshold=0.02),
    "orb": lambda count: cv2.ORB.create(nfeatures=count, fastThreshold=10),
    "akaze": lambda _: cv2.xfeatures2d.AKAZE.create(threshold=1e-4),
    "brisk": lambda _: cv2.xfeatures2d.BRISK.create(thresh=15),
    # Shi and Tomasi's "good features to track", the KLT tracker's corners.
    "klt": lambda count: cv2.GFTTDetector.create(maxCorners=count, qualityLevel=1e-3, minDistance=5),
}


def detect(gray: Pixels, detector: str, count: int) -> list[cv2.KeyPoint]:
    """Detect key points by one of `DETECTORS` except `FRONT_END_DETECTORS`, in order of falling response.

    ``count`` are wanted; detectors without a limit may return more.
    """
    points = surf.key_points(gray) if detector == "surf" else _OPENCV[detector](count).detect(gray, None)
    return sorted(points, key=lambda point: -float(point.response))


def keep_one_per_position(key_points: KeyPoints) -> list[cv2.KeyPoint]:
    """Keep the first key point at each position; SIFT returns one per strong orientation."""
    # Later entries replace earlier ones, so the first point at a position has to come last.
    return list({point.pt: point for point in reversed(key_points)}.values())[::-1]


def to_key_points(features: Records) -> list[cv2.KeyPoint]:
    """Convert the front end's corners to key points, with the angle of their sector."""
    return [
        cv2.KeyPoint(x, y, CORNER_SIZE_PX, angle, response)
        for x, y, angle, response in zip(
            (features["x"] / POSITION.one).tolist(),
            (features["y"] / POSITION.one).tolist(),
            (features["sector"] * (360.0 / SECTORS)).tolist(),
            decode_response(features["response"]).astype(float).tolist(),
            strict=True,
        )
    ]


def strip_octaves(key_points: KeyPoints) -> list[cv2.KeyPoint]:
    """Strip key points of their octave for another descriptor, because OpenCV's classes encode octaves differently."""
    return [cv2.KeyPoint(point.pt[0], point.pt[1], point.size, point.angle, point.response) for point in key_points]


def key_point_positions(key_points: KeyPoints) -> Float32:
    """Positions (N, 2) of key points, px."""
    return np.array([point.pt for point in key_points], dtype=np.float32).reshape(-1, 2)
