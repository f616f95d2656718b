"""OpenCV's detectors and descriptors with mutual check, ratio test and MAGSAC: what the project is measured against."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from golden_model.config import preset_config
from skymosaic.features.detectors import DETECTORS
from skymosaic.features.methods import backend_of, choose
from skymosaic.features.positions import match_points
from skymosaic.geometry.estimators import MAGSAC_TOLERANCE_PX, magsac
from skymosaic.geometry.homography import apply

BASELINES = ("sift", "orb", "akaze", "brisk", "freak", "surf", "klt")
"""Names of detectors, with the descriptor that goes with each; FREAK's detector is BRISK's, SURF's descriptor ours."""


class Baseline:
    """A detector and descriptor, limited to the ``count`` strongest key points."""

    def __init__(self, name: str, count: int) -> None:
        config = preset_config("aerial")
        config = dataclasses.replace(config, front_end=dataclasses.replace(config.front_end, max_features=count))
        named = {"detector": name} if name in DETECTORS else {"descriptor": name}
        method, self._config = choose(config, **named)
        self._front_end = backend_of(method, "golden")

    def homography(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> tuple[Array | None, int]:
        """Homography from left to right of two images (None where nothing was estimated), and the inliers at 3 px."""
        matches = self._front_end.run([left, right], self._config)[1].matches
        left_points, right_points = match_points(matches[matches["verdict"] == 1])
        found = magsac(left_points, right_points)
        if found is None:
            return None, 0
        error_px = np.linalg.norm(apply(found, left_points) - right_points, axis=1)
        return found, int((error_px <= MAGSAC_TOLERANCE_PX).sum())
