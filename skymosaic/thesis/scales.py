"""Figure IV-6: the share of a reduced picture's key points that are detected in the full one, too."""

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from skymosaic.evaluation.metrics import repeatability
from skymosaic.features.detectors import detect, keep_one_per_position, key_point_positions
from skymosaic.features.positions import feature_points
from skymosaic.geometry.homography import resize_matrix
from skymosaic.thesis.corners import CORNERS, detect_strongest
from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.measurements import Line

REDUCTIONS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0)
TOLERANCE_PX = 1.5
"""Maximum distance of corresponding key points, in pixels of the reduced picture (Schmid, Mohr, Bauckhage 2000)."""
CHANCE_SHIFT_PX = 12.0
"""Key points that agree after the reduced picture is shifted by this distance agree by chance."""


DETECTORS: dict[str, Callable[[Pixels, int], NDArray[np.floating]]] = {
    "SIFT": lambda gray, count: key_point_positions(keep_one_per_position(detect(gray, "sift", count))[:count]),
    "Harris": lambda gray, count: feature_points(detect_strongest(gray, count)),
}


def measure_repeatability(pair: DatasetPair) -> Iterator[Line]:
    """Measure the repeatability of the left image's key points against its reduction by area (Figure IV-6).

    The query features of equation IV-2 are those of the reduced picture. Both pictures have the same number of key
    points per area of the scene: 300 in the full one.
    """
    gray = pair.grays[0]
    height, width = gray.shape
    for name, detect_points in DETECTORS.items():
        full = detect_points(gray, CORNERS)
        for reduction in REDUCTIONS:
            size = round(width / reduction), round(height / reduction)
            reduced = cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
            points = detect_points(reduced, round(CORNERS / reduction**2))
            enlarge = resize_matrix(width / size[0], height / size[1])
            again, chance = (
                repeatability(points + shift_px, full, enlarge, (width, height), tolerance_px=TOLERANCE_PX * reduction)
                for shift_px in (0.0, CHANCE_SHIFT_PX)
            )
            yield "figure IV-6", f"{name} {reduction:g}", {"repeatability": again, "chance": chance}
