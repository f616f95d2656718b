"""The methods that register a pair: the project's own efforts, the chip, and OpenCV's detectors and descriptors.

OpenCV's are matched with mutual check and ratio test, and estimated by MAGSAC.
"""

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import typer

from golden_model.arrays import Matrix, Pixels, Points
from golden_model.config import EstimatorConfig, preset_config
from golden_model.geometry.estimator import Estimate, FrameMatches, estimate
from skymosaic import extract, register
from skymosaic.evaluation.known_pairs import KnownPair
from skymosaic.features.backends import load_backend
from skymosaic.features.detectors import DETECTORS
from skymosaic.features.matchers import RATIO
from skymosaic.features.methods import HostBackend, choose_method
from skymosaic.features.positions import match_points
from skymosaic.geometry.fabric import in_pixels
from skymosaic.imagery.images import load
from skymosaic.registration.extraction import extract_within_capacity
from skymosaic.registration.options import RegistrationOptions

FEW_FEATURES, MANY_FEATURES = 1000, 8000
OURS: dict[str, tuple[str, dict[str, Any]]] = {
    "normal": ("skymosaic", {}),
    "fast": ("skymosaic, `--effort fast`", {"effort": "fast"}),
    "thorough": ("skymosaic, `--effort thorough`", {"effort": "thorough"}),
    "fast-corners": ("skymosaic, FAST corners", {"detector": "fast"}),
    "thesis": ("skymosaic, preset `thesis`", {"preset": "thesis"}),
}
"""What ``--method`` names: the row's heading, and the options of `skymosaic.register` behind it."""
ON_CHIP = "on the chip alone"
REFERENCE = f"SIFT, {FEW_FEATURES} features"
"""The row whose processor time is 1."""
PEERS = {
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
Method = Callable[[KnownPair, int], Iterator[Matrix | None]]
"""Takes a pair and the number of seeds; yields the homography of each seed."""


def chosen_methods(wanted: list[str] | None) -> dict[str, Method]:
    """The methods to run, by the heading of their row; ``wanted`` are names of methods (None: all)."""
    named = {name: {heading: ours(**options)} for name, (heading, options) in OURS.items()}
    named["chip"] = {ON_CHIP: chip}
    named |= {name: {f"{title}, {FEW_FEATURES} features": peer(name, FEW_FEATURES)} for name, title in PEERS.items()}
    named["sift"] |= {f"SIFT, {MANY_FEATURES}": peer("sift", MANY_FEATURES)}
    named["rootsift"] = {f"RootSIFT, {MANY_FEATURES}": peer("rootsift", MANY_FEATURES)}
    if unknown := [name for name in wanted or () if name not in named]:
        raise typer.BadParameter(f"no method {', '.join(unknown)}; valid: {', '.join(named)}")
    return {heading: run for name in wanted or named for heading, run in named[name].items()}


def ours(**options: Any) -> Method:
    """The project's own registration; its features serve all seeds."""

    def run(pair: KnownPair, seeds: int) -> Iterator[Matrix | None]:
        is_shared = "detector" not in options and "preset" not in options
        left, right = (extract(side) if is_shared else side for side in (pair.left, pair.right))
        for seed in range(seeds):
            yield register(left, right, seed=seed, **options).homography

    return run


def chip(pair: KnownPair, seeds: int) -> Iterator[Matrix | None]:
    """Front end, matcher and estimator of the hardware, with nothing of the host's."""
    for result in estimate_on_chip(load(pair.left).pixels, load(pair.right).pixels, seeds):
        yield None if result.causes else in_pixels(result.homography)


def estimate_on_chip(left: Pixels, right: Pixels, seeds: int = 1) -> Iterator[Estimate]:
    """The golden model of the whole chip, for a pair of images and each seed."""
    _, config = RegistrationOptions().choose_method()
    (_, result), _ = extract_within_capacity(load_backend("golden"), [left, right], config)
    matches = FrameMatches.from_records(result.matches, result.status)
    for seed in range(seeds):
        yield estimate(matches, EstimatorConfig(seed=EstimatorConfig().seed + seed))


def peer(name: str, count: int) -> Method:
    """One of `PEERS`, or ``rootsift``, on the same files with the ``count`` strongest key points; its seed is fixed."""

    def run(pair: KnownPair, _seeds: int) -> Iterator[Matrix | None]:
        left, right = read_gray(pair.left), read_gray(pair.right)
        if name == "rootsift" or count > MAX_PROJECT_FEATURES:
            points = sift_matches(left, right, count, root=name == "rootsift")
        else:
            points = project_matches(left, right, name, count)
        H = None
        if len(points[0]) >= 4:
            H, _ = cv2.findHomography(*points, cv2.USAC_MAGSAC, TOLERANCE_PX, maxIters=ROUNDS, confidence=CONFIDENCE)
        yield H

    return run


def read_gray(image: Path) -> Pixels:
    """A pair's image."""
    return np.asarray(cv2.imread(str(image), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


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
