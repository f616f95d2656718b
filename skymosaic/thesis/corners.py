"""Harris corners selected by threshold (Table IV-1), by number, and by the quality of their matches."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels, Records
from golden_model.config import LARGEST_THRESHOLD, PRESETS, FrontEndConfig
from golden_model.formats import decode_response
from golden_model.front_end import extract, trace
from skymosaic.evaluation.metrics import correct_matches, repeatability
from skymosaic.features.descriptors import describe
from skymosaic.features.detectors import from_features
from skymosaic.features.matchers import correlation_matches
from skymosaic.features.positions import feature_points, match_points
from skymosaic.geometry.estimators import ransac
from skymosaic.geometry.fuzzy_ransac import TOLERANCE_PX
from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.measurements import Line

CORNERS = 300
"""Corners per image if an experiment needs a number: about the mean of the published 358 and 239."""
BORDER_PX = 16
"""The largest window's support, so that every experiment sees the same corners."""
THRESHOLDS = [round(2 ** (step / 2)) for step in range(8, 61)]
"""Thresholds of our measure, in steps of half an octave; the thesis does not state the scale of its thresholds."""
QUALITY_WINDOW = "window-10"
QUALITY_TARGET = 0.8
LOWEST_THRESHOLD = 2**12
FEWEST_CORNERS = 50

FRONT_END = dataclasses.replace(PRESETS["thesis"].front_end, border_px=BORDER_PX, max_features=4096)
"""The thesis preset with a wider border and as many corners as a feature bank can hold."""


def strongest(image: Pixels, count: int = CORNERS, descriptor: str = FRONT_END.descriptor) -> Records:
    """The features with the ``count`` largest responses (more where several are equal), in raster order."""
    return extract(image, _front_end(threshold_of(image, count), descriptor)).features


def threshold_of(image: Pixels, count: int = CORNERS) -> int:
    """The threshold that leaves ``count`` corners: more if several are equal, all if there are fewer."""
    falling = np.sort(responses(image))[::-1]
    return int(falling[min(count, len(falling)) - 1]) if len(falling) else 1


def responses(image: Pixels) -> NDArray[np.int32]:
    """The Harris measure of every corner after non-maximum suppression, (N,)."""
    candidates = trace(image, _front_end(1)).levels[0]["candidates"].values
    return decode_response(candidates[candidates > 0])


def by_threshold(pair: DatasetPair) -> Iterator[Line]:
    """For Table IV-1: number of corners in both images above each of `THRESHOLDS`."""
    found = [responses(gray) for gray in pair.grays]
    for threshold in THRESHOLDS:
        left, right = (int(np.count_nonzero(each >= threshold)) for each in found)
        yield "IV-1", str(threshold), {"left": left, "right": right}


def by_quality(pair: DatasetPair) -> Iterator[Line]:
    """The adaptive threshold's first and last value, with the number of corners and their repeatability at each."""
    rounds = raised_threshold(pair.grays)
    for setting, last in (("lowest threshold", rounds[0]), ("threshold reached", rounds[-1])):
        left, right = map(feature_points, last.features)
        yield (
            "adaptive",
            setting,
            {
                "threshold": last.threshold,
                "left": len(left),
                "right": len(right),
                "quality": last.quality,
                "repeatability": repeatability(left, right, pair.truth, pair.sizes[1]),
            },
        )


@dataclass(frozen=True, eq=False)
class Round:
    """One threshold of the adaptive search, the features of both images above it, and the quality of their matches."""

    threshold: int
    features: tuple[Records, Records]
    quality: float


def raised_threshold(grays: tuple[Pixels, Pixels], target: float = QUALITY_TARGET) -> list[Round]:
    """The adaptive threshold (sections II.2.1.2 and III.6.1.1): start low, double until the matches are good enough.

    The quality of matches, which the thesis calls recall, is the share of mutual SAD matches of 10x10 windows that
    agree with the homography that RANSAC finds among them. This needs no true homography.

    Returns
    -------
    list of Round
        At least one. The last one reached ``target``, or the next threshold would leave too few corners.
    """
    rounds: list[Round] = []
    threshold = LOWEST_THRESHOLD
    while threshold <= LARGEST_THRESHOLD["harris"]:
        left, right = (extract(gray, _front_end(threshold)) for gray in grays)
        threshold *= 2
        if not (left.status["good"] and right.status["good"]):
            continue
        features = left.features, right.features
        if rounds and min(map(len, features)) < FEWEST_CORNERS:
            break
        rounds.append(Round(threshold // 2, features, _quality(grays, features)))
        if rounds[-1].quality >= target:
            break
    return rounds


def _quality(grays: tuple[Pixels, Pixels], features: tuple[Records, Records]) -> float:
    left, right = (
        describe(gray, from_features(found), QUALITY_WINDOW) for gray, found in zip(grays, features, strict=True)
    )
    points = match_points(correlation_matches(left, right))
    H = ransac(*points)
    return 0.0 if H is None else float(np.mean(correct_matches(*points, H, tolerance_px=TOLERANCE_PX)))


def _front_end(threshold: int, descriptor: str = FRONT_END.descriptor) -> FrontEndConfig:
    return dataclasses.replace(FRONT_END, threshold=threshold, descriptor=descriptor)
