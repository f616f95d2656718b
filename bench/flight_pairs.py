"""Cuts pairs with a pseudo truth out of flights.

Photographs up to three apart in a flight are registered by SIFT at 1600 px with a loose tolerance and refitted to the
inliers. So the truth favours SIFT, keeps pairs that SIFT solves, and with relief is one of several planes: where ours
correlates better than the truth, the truth is the one that is off.
"""

import random
from collections.abc import Collection, Iterator
from pathlib import Path

import cv2
import numpy as np
from rich.progress import track

from bench.peers import sift_matches
from golden_model.arrays import Matrix, Pixels
from golden_model.pixel.gray import to_gray
from skymosaic.geometry.acceptance import hull_area, overlap
from skymosaic.imagery.images import load, reduce_to_width
from skymosaic.imagery.photographs import list_sources

TRUTH_WIDTH_PX, WIDTH_PX = 1600, 640
SIFT_FEATURES = 6000
TOLERANCE_PX = 4.0
MIN_INLIERS, MIN_INLIER_SHARE = 60, 0.3
OVERLAPS = (0.15, 0.8)
MAX_STEP = 3


def cut(folder: Path, count: int, known: Collection[str]) -> Iterator[tuple[str, str, Pixels, Pixels, Matrix]]:
    """At most ``count`` pairs of a flight, the same on every run, none of which has a name in ``known``."""
    photographs = list_sources([folder])
    word = folder.name.split("_")[0]
    steps = [(i, i + step) for step in range(1, MAX_STEP + 1) for i in range(len(photographs) - step)]
    random.Random(5).shuffle(steps)
    given = 0
    for i, j in track(sorted(steps[: 3 * count]), description=word):
        name = f"real_{word}_{i}_{j}"
        if given == count or name in known:
            continue
        left, right = (reduce_to_width(to_gray(load(photographs[k].content).pixels), TRUTH_WIDTH_PX)[0] for k in (i, j))
        truth = pseudo_truth(left, right)
        if truth is not None:
            given += 1
            small, to_large = zip(*(reduce_to_width(image, WIDTH_PX) for image in (left, right)), strict=True)
            yield name, "unseen", *small, np.linalg.inv(to_large[1]) @ truth @ to_large[0]


def pseudo_truth(left: Pixels, right: Pixels) -> Matrix | None:
    """The homography by RootSIFT and MAGSAC, fitted again to its inliers; None where it is doubtful."""
    left_points, right_points = sift_matches(left, right, SIFT_FEATURES, root=True)
    if len(left_points) < MIN_INLIERS:
        return None
    H, mask = cv2.findHomography(
        left_points, right_points, cv2.USAC_MAGSAC, TOLERANCE_PX, maxIters=20_000, confidence=0.99999
    )
    if H is None or mask.sum() < MIN_INLIERS or mask.mean() < MIN_INLIER_SHARE:
        return None
    inliers = mask.ravel() > 0
    H, _ = cv2.findHomography(left_points[inliers], right_points[inliers], 0)
    size = left.shape[1], left.shape[0]
    share = hull_area(overlap(H, size, (right.shape[1], right.shape[0]))) / (size[0] * size[1])
    return H if OVERLAPS[0] <= share <= OVERLAPS[1] else None
