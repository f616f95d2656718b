"""OpenCV's detectors with mutual check, ratio test and MAGSAC: what the project is measured against."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

RATIO = 0.8
MAGSAC_THRESHOLD_PX = 3.0
MAGSAC_ITERATIONS = 10_000
FEWEST_MATCHES = 4


@dataclass(frozen=True)
class Baseline:
    """A detector and descriptor of OpenCV, limited to the ``count`` strongest key points."""

    name: str
    count: int

    def homography(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> tuple[NDArray[np.float64] | None, int]:
        """Homography from left to right of two gray images (None where nothing was estimated), and the inliers."""
        (left_points, left_descriptors), (right_points, right_descriptors) = map(self._features, (left, right))
        if min(len(left_points), len(right_points)) < 2:
            return None, 0
        pairs = self._mutual_matches(left_descriptors, right_descriptors)
        if len(pairs) < FEWEST_MATCHES:
            return None, 0
        source, target = left_points[pairs[:, 0]], right_points[pairs[:, 1]]
        found, inliers = cv2.findHomography(
            source, target, cv2.USAC_MAGSAC, MAGSAC_THRESHOLD_PX, maxIters=MAGSAC_ITERATIONS, confidence=0.9999
        )
        return found, 0 if found is None else int(inliers.sum())

    def _features(self, image: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.generic]]:
        detector = DETECTORS[self.name](self.count)
        key_points = sorted(detector.detect(image, None), key=lambda point: -point.response)[: self.count]
        key_points, descriptors = detector.compute(image, key_points)
        points = np.array([point.pt for point in key_points], np.float32).reshape(-1, 2)
        return points, descriptors if descriptors is not None else np.empty((0, 0), np.uint8)

    def _mutual_matches(self, left: NDArray[np.generic], right: NDArray[np.generic]) -> NDArray[np.intp]:
        matcher = cv2.BFMatcher(cv2.NORM_L2 if left.dtype == np.float32 else cv2.NORM_HAMMING)
        forward = matcher.knnMatch(left, right, k=2)
        backward = {match.queryIdx: match.trainIdx for match in matcher.match(right, left)}
        kept = [
            (best.queryIdx, best.trainIdx)
            for best, second in forward
            if best.distance < RATIO * second.distance and backward[best.trainIdx] == best.queryIdx
        ]
        return np.array(kept, np.intp).reshape(-1, 2)


DETECTORS: dict[str, Callable[[int], cv2.Feature2D]] = {
    "sift": lambda count: cv2.SIFT_create(nfeatures=count, contrastThreshold=0.02),
    "orb": lambda count: cv2.ORB_create(nfeatures=count, fastThreshold=10),
    "akaze": lambda _: cv2.xfeatures2d.AKAZE_create(threshold=1e-4),
    "brisk": lambda _: cv2.xfeatures2d.BRISK_create(thresh=15),
}
"""Each baseline's OpenCV constructor, thresholds low enough to fill the count; the rest is cut by response."""
