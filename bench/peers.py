"""OpenCV's detectors and descriptors, with mutual check, ratio test and MAGSAC: what we compare with."""

import dataclasses

import cv2
import numpy as np

from golden_model.arrays import Matrix, Pixels, Points
from golden_model.config import preset_config
from skymosaic.features.detectors import DETECTORS
from skymosaic.features.matchers import RATIO
from skymosaic.features.methods import HostBackend, choose_method
from skymosaic.features.positions import match_points

METHODS = {
    "sift": "SIFT",
    "orb": "ORB",
    "akaze": "AKAZE",
    "brisk": "BRISK",
    "freak": "FREAK",
    "surf": "SURF",
    "klt": "KLT",
}
"""Detectors, with the descriptor that goes with each; FREAK's detector is BRISK's, SURF's descriptor ours."""
TOLERANCE_PX = 3.0
ROUNDS = 10_000
CONFIDENCE = 0.9999
MAX_PROJECT_FEATURES = 4096
"""More are matched by `sift_matches`."""
Words = tuple[Points, np.ndarray]
"""Positions (N, 2) of key points and their descriptors (N, 128)."""


def register_by_peer(left: Pixels, right: Pixels, name: str, count: int) -> Matrix | None:
    """The homography of two gray images by MAGSAC; None where none was estimated.

    The matches are those of one of `METHODS`, or of ``rootsift``, with the ``count`` strongest key points.
    """
    if name == "rootsift" or count > MAX_PROJECT_FEATURES:
        points = sift_matches(left, right, count, root=name == "rootsift")
    else:
        points = project_matches(left, right, name, count)
    if len(points[0]) < 4:
        return None
    H, _ = cv2.findHomography(*points, cv2.USAC_MAGSAC, TOLERANCE_PX, maxIters=ROUNDS, confidence=CONFIDENCE)
    return H


def project_matches(left: Pixels, right: Pixels, name: str, count: int) -> tuple[Points, Points]:
    """Left and right points (N, 2) of a detector and descriptor as the project offers them."""
    config = preset_config("aerial")
    config = dataclasses.replace(config, front_end=dataclasses.replace(config.front_end, max_features=count))
    method, config = choose_method(config, **{"detector" if name in DETECTORS else "descriptor": name})
    matches = HostBackend(method).run([left, right], config)[1].matches
    return match_points(matches[matches["verdict"] == 1])


def sift_matches(left: Pixels, right: Pixels, count: int, *, root: bool) -> tuple[Points, Points]:
    """Points (N, 2) of SIFT with any number of features; ``root``: by the Hellinger distance (Arandjelovic 2012)."""
    return match_words(sift_words(left, count, root=root), sift_words(right, count, root=root))


def sift_words(image: Pixels, count: int, *, root: bool = False) -> Words:
    """Positions and descriptors of the strongest key points."""
    key_points, words = cv2.SIFT.create(count).detectAndCompute(image, None)
    if words is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    if root:
        words = np.sqrt(words / np.maximum(words.sum(axis=1, keepdims=True), 1e-9))
    return np.array([point.pt for point in key_points]), words


def match_words(left: Words, right: Words) -> tuple[Points, Points]:
    """Points (N, 2) of matches that pass the mutual check and the ratio test."""
    (left_points, left_words), (right_points, right_words) = left, right
    if min(len(left_points), len(right_points)) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(right_words, left_words)}
    pairs = [
        (best.queryIdx, best.trainIdx)
        for best, second in matcher.knnMatch(left_words, right_words, k=2)
        if best.distance < RATIO * second.distance and back[best.trainIdx] == best.queryIdx
    ]
    rows, columns = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
    return left_points[rows], right_points[columns]
