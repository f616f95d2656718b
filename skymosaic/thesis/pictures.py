"""Pictures of one pair: corners, the matches each fuzzy system keeps and rejects, the mosaic."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from golden_model.arrays import Pixels
from golden_model.config import PRESETS
from skymosaic.common.errors import RegistrationError
from skymosaic.mosaicking.api import mosaic
from skymosaic.registration.register import register
from skymosaic.reports import figures
from skymosaic.thesis.corners import find_threshold
from skymosaic.thesis.dataset import DatasetPair


def draw_pair(pair: DatasetPair) -> Iterator[tuple[str, Pixels]]:
    """Draw the pictures, each with its caption."""
    sides = pair.left, pair.right
    thesis, threshold = PRESETS["thesis"], max(map(find_threshold, pair.grays))
    thesis = dataclasses.replace(thesis, front_end=dataclasses.replace(thesis.front_end, threshold=threshold))
    ilbp = register(*sides, config=thesis)
    yield "Harris corners of the thesis preset, left image", figures.draw_corners(ilbp.working[0], ilbp.features[0])
    yield "Harris corners of the thesis preset, right image", figures.draw_corners(ilbp.working[1], ilbp.features[1])
    windows = register(*sides, config=thesis, detector="harris", descriptor="window-10")
    yield "1. Fuzzy correlation, SAD of 10x10 windows: good matches are kept", figures.draw_matches(windows)
    yield "2. Fuzzy ILBP, four rings", figures.draw_matches(ilbp)
    sift = register(*sides, detector="sift", descriptor="thesis-ilbp-4", estimator="fuzzy-ransac")
    yield "3. Fuzzy RANSAC, SIFT + ILBP: kept are the verified, ringed the inliers", figures.draw_matches(sift)
    yield "The aerial preset's eight rules", figures.draw_matches(register(*sides))
    try:
        yield "Mosaic by the aerial preset", np.asarray(mosaic(sides).image, dtype=np.uint8)
    except RegistrationError:
        return
