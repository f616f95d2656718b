"""OpenCV's detectors, descriptors and robust estimators, with mutual check and ratio test: what we compare with."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels, Points
from golden_model.config import preset_config
from skymosaic.features.detectors import DETECTORS
from skymosaic.features.matchers import RATIO
from skymosaic.features.methods import choose_method, load_backend_for
from skymosaic.features.positions import match_points
from skymosaic.geometry.homography import apply

BASELINES = ("sift", "orb", "akaze", "brisk", "freak", "surf", "klt")
"""Names of detectors, with the descriptor that goes with each; FREAK's detector is BRISK's, SURF's descriptor ours."""
ESTIMATORS = {"magsac": cv2.USAC_MAGSAC, "accurate": cv2.USAC_ACCURATE, "fast": cv2.USAC_FAST}
"""OpenCV's estimators: MAGSAC++, and its general framework set for accuracy or for speed."""
TOLERANCE_PX = 3.0
ROUNDS = 10_000
CONFIDENCE = 0.9999


class Matcher(Protocol):
    """Finds matches between two gray images."""

    def match(self, left: Pixels, right: Pixels) -> tuple[Points, Points]:
        """Left and right points (N, 2)."""
        ...


class OfProject:
    """A detector and descriptor as the project offers them, limited to the ``count`` strongest key points."""

    def __init__(self, name: str, count: int) -> None:
        config = preset_config("aerial")
        config = dataclasses.replace(config, front_end=dataclasses.replace(config.front_end, max_features=count))
        named = {"detector": name} if name in DETECTORS else {"descriptor": name}
        method, self._config = choose_method(config, **named)
        self._front_end = load_backend_for(method, "golden")

    def match(self, left: Pixels, right: Pixels) -> tuple[Points, Points]:
        """See `Matcher.match`."""
        matches = self._front_end.run([left, right], self._config)[1].matches
        return match_points(matches[matches["verdict"] == 1])


class ManySift:
    """SIFT with any number of features, ``root``: compared by the Hellinger distance (Arandjelovic and Zisserman)."""

    def __init__(self, count: int, *, root: bool) -> None:
        self._sift, self._root = cv2.SIFT_create(count), root

    def match(self, left: Pixels, right: Pixels) -> tuple[Points, Points]:
        """See `Matcher.match`."""
        (left_points, left_words), (right_points, right_words) = map(self._described, (left, right))
        if min(len(left_points), len(right_points)) < 2:
            return np.zeros((0, 2)), np.zeros((0, 2))
        matcher = cv2.BFMatcher(cv2.NORM_L2)
        back = {match.queryIdx: match.trainIdx for match in matcher.match(right_words, left_words)}
        pairs = [
            (best.queryIdx, best.trainIdx)
            for best, second in matcher.knnMatch(left_words, right_words, k=2)
            if best.distance < RATIO * second.distance and back[best.trainIdx] == best.queryIdx
        ]
        chosen = np.array(pairs, dtype=np.intp).reshape(-1, 2)
        return left_points[chosen[:, 0]], right_points[chosen[:, 1]]

    def _described(self, image: Pixels) -> tuple[Points, np.ndarray]:
        key_points, words = self._sift.detectAndCompute(image, None)
        if words is None:
            return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
        if self._root:
            words = np.sqrt(words / np.maximum(words.sum(axis=1, keepdims=True), 1e-9))
        return np.array([point.pt for point in key_points]), words


class Baseline:
    """Matches of an OpenCV method, and a homography by one of OpenCV's estimators."""

    def __init__(self, name: str, count: int, estimator: str = "magsac") -> None:
        several = {"sift": False, "rootsift": True}
        many = name == "rootsift" or (name in several and count > 4096)
        self._matcher: Matcher = ManySift(count, root=several[name]) if many else OfProject(name, count)
        self._estimator = ESTIMATORS[estimator]

    def homography(self, left: Pixels, right: Pixels) -> tuple[Array | None, int]:
        """Homography from left to right of two images (None where nothing was estimated), and the inliers at 3 px."""
        left_points, right_points = self._matcher.match(left, right)
        if len(left_points) < 4:
            return None, 0
        found, _ = cv2.findHomography(
            left_points, right_points, self._estimator, TOLERANCE_PX, maxIters=ROUNDS, confidence=CONFIDENCE
        )
        if found is None:
            return None, 0
        error_px = np.linalg.norm(apply(found, left_points) - right_points, axis=1)
        return found, int((error_px <= TOLERANCE_PX).sum())
