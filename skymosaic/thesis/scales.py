"""Figure IV-6: how many key points of a reduced picture are also found in the full one."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from skymosaic.evaluation.metrics import repeatability
from skymosaic.features.detectors import detect, one_per_position, points_of
from skymosaic.features.positions import feature_points
from skymosaic.geometry.homography import resize_matrix
from skymosaic.thesis.corners import CORNERS, strongest
from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.measurements import Line

REDUCTIONS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0)
TOLERANCE_PX = 1.5
"""Largest distance of corresponding key points, in pixels of the reduced picture (Schmid, Mohr and Bauckhage, 2000)."""
CHANCE_SHIFT_PX = 12.0
"""Key points that agree after the reduced picture is shifted by this distance agree by chance."""


def _sift(gray: Pixels, count: int) -> NDArray[np.floating]:
    return points_of(one_per_position(detect(gray, "sift", count))[:count])


def _harris(gray: Pixels, count: int) -> NDArray[np.floating]:
    return feature_points(strongest(gray, count))


FINDERS: dict[str, Callable[[Pixels, int], NDArray[np.floating]]] = {"SIFT": _sift, "Harris": _harris}


def by_reduction(pair: DatasetPair) -> Iterator[Line]:
    """Figure IV-6: repeatability of the left image's key points as a function of its reduction by area.

    The query features of equation IV-2 are those of the reduced picture. Both pictures have the same number of key
    points per area of the scene: 300 in the full one.
    """
    gray = pair.grays[0]
    height, width = gray.shape
    for name, find in FINDERS.items():
        full = find(gray, CORNERS)
        for reduction in REDUCTIONS:
            size = round(width / reduction), round(height / reduction)
            reduced = cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
            found = find(reduced, round(CORNERS / reduction**2))
            enlarge = resize_matrix(width / size[0], height / size[1])
            again, chance = (
                repeatability(found + shift_px, full, enlarge, (width, height), tolerance_px=TOLERANCE_PX * reduction)
                for shift_px in (0.0, CHANCE_SHIFT_PX)
            )
            yield "figure IV-6", f"{name} {reduction:g}", {"repeatability": again, "chance": chance}
