"""Harris corners selected by threshold (Table IV-1), by number, and by the quality of their matches."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels, Records
from golden_model.config import MAX_THRESHOLD, PRESETS, FrontEndConfig
from golden_model.formats import decode_response
from golden_model.front_end import extract, trace
from skymosaic.evaluation.metrics import correct_matches, repeatability
from skymosaic.features.descriptors import describe
from skymosaic.features.detectors import to_key_points
from skymosaic.features.matchers import match_by_correlation
from skymosaic.features.positions import feature_points, match_points
from skymosaic.geometry.estimators import estimate_by_opencv
from skymosaic.geometry.fuzzy_ransac import TOLERANCE_PX
from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.measurements import Line

CORNERS = 300
"""Corners per image if an experiment needs a number: about the mean of the published 358 and 239."""
BORDER_PX = 16
"""Support of the largest window, so that all experiments use the same corners."""
THRESHOLDS = [round(2 ** (step / 2)) for step in range(8, 61)]
"""Thresholds of our Harris measure, in steps of half an octave; the thesis does not state the scale of its own."""
QUALITY_WINDOW = "window-10"
QUALITY_TARGET = 0.8
START_THRESHOLD = 2**12
MIN_CORNERS = 50

FRONT_END = dataclasses.replace(PRESETS["thesis"].front_end, border_px=BORDER_PX, max_features=4096)
"""The thesis preset with a wider border and as many corners as a feature bank can hold."""


def detect_strongest(image: Pixels, count: int = CORNERS, descriptor: str = FRONT_END.descriptor) -> Records:
    """Detect the ``count`` features with the largest responses (more if several are equal), in raster order."""
    return extract(image, _configure(find_threshold(image, count), descriptor)).features


def find_threshold(image: Pixels, count: int = CORNERS) -> int:
    """Find the threshold that leaves ``count`` corners: more if several are equal, all if there are fewer."""
    falling = np.sort(compute_responses(image))[::-1]
    return int(falling[min(count, len(falling)) - 1]) if len(falling) else 1


def compute_responses(image: Pixels) -> NDArray[np.int32]:
    """Compute the Harris measure of every corner that non-maximum suppression leaves, (N,)."""
    candidates = trace(image, _configure(1)).levels[0]["candidates"].values
    return decode_response(candidates[candidates > 0])


def measure_corners(pair: DatasetPair) -> Iterator[Line]:
    """Count the corners of both images above each of `THRESHOLDS`, for Table IV-1."""
    responses = [compute_responses(gray) for gray in pair.grays]
    for threshold in THRESHOLDS:
        left, right = (int(np.count_nonzero(each >= threshold)) for each in responses)
        yield "IV-1", str(threshold), {"left": left, "right": right}


def measure_adaptive_threshold(pair: DatasetPair) -> Iterator[Line]:
    """Count the corners at the first and last value of the adaptive threshold, with their repeatability."""
    rounds = raise_threshold(pair.grays)
    for setting, shown in (("lowest threshold", rounds[0]), ("threshold reached", rounds[-1])):
        left, right = map(feature_points, shown.features)
        counts = {"threshold": shown.threshold, "left": len(left), "right": len(right), "quality": shown.quality}
        again = repeatability(left, right, pair.truth, pair.sizes[1])
        yield "adaptive", setting, {**counts, "repeatability": again}


@dataclass(frozen=True, eq=False)
class Round:
    """One threshold of the adaptive search, the features of both images above it, and the quality of their matches."""

    threshold: int
    features: tuple[Records, Records]
    quality: float


def raise_threshold(grays: tuple[Pixels, Pixels], target: float = QUALITY_TARGET) -> list[Round]:
    """Start with a low threshold and double it until the matches are good enough (sections II.2.1.2 and III.6.1.1).

    The quality of matches, which the thesis calls recall, is the share of mutual SAD matches of 10x10 windows that
    agree with the homography that RANSAC finds among them. This needs no true homography. There is at least one round;
    the last one reached ``target``, or the next threshold would leave too few corners.
    """
    rounds: list[Round] = []
    threshold = START_THRESHOLD
    while threshold <= MAX_THRESHOLD["harris"]:
        left, right = (extract(gray, _configure(threshold)) for gray in grays)
        threshold *= 2
        # A frame with more corners than a feature bank holds is bad: it has no features.
        if not (left.status["good"] and right.status["good"]):
            continue
        features = left.features, right.features
        if rounds and min(map(len, features)) < MIN_CORNERS:
            break
        rounds.append(Round(threshold // 2, features, _measure_quality(grays, features)))
        if rounds[-1].quality >= target:
            break
    return rounds


def _measure_quality(grays: tuple[Pixels, Pixels], features: tuple[Records, Records]) -> float:
    left, right = (
        describe(gray, to_key_points(each), QUALITY_WINDOW) for gray, each in zip(grays, features, strict=True)
    )
    points = match_points(match_by_correlation(left, right))
    H = estimate_by_opencv("ransac", *points)
    return 0.0 if H is None else float(np.mean(correct_matches(*points, H, tolerance_px=TOLERANCE_PX)))


def _configure(threshold: int, descriptor: str = FRONT_END.descriptor) -> FrontEndConfig:
    return dataclasses.replace(FRONT_END, threshold=threshold, descriptor=descriptor)
