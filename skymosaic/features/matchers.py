"""Matchers beyond those of the front end: ratio test, window correlation, KLT tracking.

All return `golden_model.records.MATCH` records in order of the left index. ``verdict`` is 1 for matches that passed the
bidirectional check or the fuzzy rules.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Float32, Mask, Pixels, Records
from golden_model.formats import WEIGHT
from golden_model.matching import correlation, rule_bases
from golden_model.matching.matcher import pair_features
from skymosaic.features.positions import feature_points, raw_positions

RATIO = 0.8
"""A match is distinct if its distance is below this share of the distance to the second nearest (equation II-7)."""
GOOD_MATCH_ABOVE = 191
"""Fuzzy correlation keeps weights nearer to that of a good match (255) than of a medium one (128)."""
TRACKING_WINDOW_PX = 21
TRACKING_LEVELS = 5
RETURN_TOLERANCE_PX = 1.0
"""A corner tracked into the other image and back must return to within this distance of its start."""

RATIO_RULES = ("nearest in both directions", "nearest in one direction only")
TRACKING_RULES = ("tracked there and back", "lost on the way back")


def match_by_ratio(left: Records, right: Records, norm: int) -> Records:
    """Match by the ratio test (equation II-7) and the bidirectional check (section III.5.2).

    Each right feature has at most one match. ``weight`` is 1 - nearest / second nearest, ``verdict`` is 1 where the
    left feature is also the right one's nearest neighbour, ``rule`` indexes `RATIO_RULES`. The norm of the descriptors
    is ``cv2.NORM_L2`` or ``cv2.NORM_HAMMING``.
    """
    if len(left) < 2 or len(right) < 2:
        return pair_features(left, right, np.zeros(0, np.intp), np.zeros(0, np.intp))
    distance, nearest = _nearest(left, right, norm, 2)
    _, back = _nearest(right, left, norm, 1)
    distinct = np.flatnonzero(distance[:, 0] < RATIO * distance[:, 1])
    # Of the left features that share a nearest right feature, only the closest is matched: np.unique takes the first.
    closest_first = distinct[np.argsort(distance[distinct, 0], kind="stable")]
    _, first = np.unique(nearest[closest_first, 0], return_index=True)
    chosen = np.sort(closest_first[first])

    partner = nearest[chosen, 0]
    best, second = distance[chosen].T
    matches = pair_features(left, right, chosen, partner)
    matches["distance"], matches["margin"] = np.rint(best), np.rint(second) - np.rint(best)
    matches["weight"] = np.rint(WEIGHT.max_raw * (1 - best / second))
    matches["verdict"] = back[partner, 0] == chosen
    matches["rule"] = 1 - matches["verdict"]
    return matches


def match_by_correlation(left: Records, right: Records) -> Records:
    """Match mutually nearest windows of one size under SAD, weighted by fuzzy correlation (Tables III-1 and III-2).

    ``verdict`` is 1 for a good match, ``rule`` indexes the 27 rules, ``distance`` is the SAD per pixel in 1/16 gray
    levels.
    """
    if len(left) == 0 or len(right) == 0:
        return pair_features(left, right, np.zeros(0, np.intp), np.zeros(0, np.intp))
    _, nearest = _nearest(left, right, cv2.NORM_L1, 1)
    _, back = _nearest(right, left, cv2.NORM_L1, 1)
    chosen = np.flatnonzero(back[nearest[:, 0], 0] == np.arange(len(left)))
    partner = nearest[chosen, 0]
    matches = pair_features(left, right, chosen, partner)
    scores = correlation.fuzzy_inputs(left["descriptor"][chosen], right["descriptor"][partner])
    matches["distance"] = scores[0]
    matches["weight"], matches["rule"] = rule_bases.correlation().evaluate(*scores)
    matches["verdict"] = matches["weight"] > GOOD_MATCH_ABOVE
    return matches


def track_features(left_gray: Pixels, right_gray: Pixels, left: Records, right: Records) -> tuple[Records, Records]:
    """Follow the left features into the right image with the pyramidal KLT tracker (equations II-8 to II-11).

    The sizes of the images may differ. Returns ``right``, followed by a feature per tracked left one at its position in
    the right image; and the matches, whose ``verdict`` is 1 where the feature, tracked back, returns to its start, and
    whose ``rule`` indexes `TRACKING_RULES`.
    """
    start = feature_points(left).astype(np.float32)
    if len(left) == 0:
        return right, pair_features(left, right, np.zeros(0, np.intp), np.zeros(0, np.intp))
    height, width = right_gray.shape
    left_gray, right_gray = _pad_to_one_size(left_gray, right_gray)
    there, arrives = _track(left_gray, right_gray, start)
    back, returns = _track(right_gray, left_gray, there)
    inside = arrives & ((there >= 0) & (there <= (width - 1, height - 1))).all(axis=1)
    index = np.flatnonzero(inside)
    arrived = left[index].copy()
    arrived["x"], arrived["y"] = raw_positions(there[index]).T
    features = np.concatenate([right, arrived])
    features["index"] = np.arange(len(features))
    matches = pair_features(left, features, index, len(right) + np.arange(len(index)))
    kept = returns & (np.linalg.norm(back - start, axis=1) <= RETURN_TOLERANCE_PX)
    matches["weight"], matches["verdict"] = WEIGHT.max_raw, kept[index]
    matches["rule"] = 1 - matches["verdict"]
    return features, matches


def _nearest(queries: Records, candidates: Records, norm: int, count: int) -> tuple[Array, NDArray[np.int32]]:
    """Distances and indices (N, count) of each query's nearest candidates: nearest first, then the lowest index."""
    first, second = (np.ascontiguousarray(records["descriptor"]) for records in (queries, candidates))
    if norm == cv2.NORM_L2:
        # OpenCV takes ten times as long for L2 distances of bytes.
        first, second = first.astype(np.float32), second.astype(np.float32)
    # Distances of bytes in other norms are whole numbers.
    kind = cv2.CV_32F if norm == cv2.NORM_L2 else cv2.CV_32S
    distance, index = cv2.batchDistance(first, second, kind, normType=norm, K=count)
    return distance.astype(np.float64), index


def _pad_to_one_size(*images: Pixels) -> list[Pixels]:
    """Pad images to their largest height and width by repeating last rows and columns; OpenCV tracks in no others."""
    height, width = np.max([image.shape for image in images], axis=0)
    return [np.pad(image, ((0, height - image.shape[0]), (0, width - image.shape[1])), "edge") for image in images]


def _track(before: Pixels, after: Pixels, points: Float32) -> tuple[Float32, Mask]:
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        before, after, points, None, winSize=(TRACKING_WINDOW_PX, TRACKING_WINDOW_PX), maxLevel=TRACKING_LEVELS
    )
    return moved, status[:, 0] == 1
