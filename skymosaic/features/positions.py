"""Positions of feature and match records in pixels, and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Points, Records
from golden_model.formats import POSITION


def feature_points(features: Records) -> Points:
    """Positions (N, 2) of feature records (`golden_model.records.feature_record`), working px."""
    return np.stack((features["x"], features["y"]), axis=1) / POSITION.one


def match_points(matches: Records) -> tuple[Points, Points]:
    """Left and right positions, (N, 2) each, of match records (`golden_model.records.MATCH`), working px."""
    left = np.stack((matches["left_x"], matches["left_y"]), axis=1) / POSITION.one
    right = np.stack((matches["right_x"], matches["right_y"]), axis=1) / POSITION.one
    return left, right


def raw_positions(points: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Points (N, 2) in px as the records store them (`golden_model.formats.POSITION`): 1/16 px, halves rounded up.

    Positions outside the format's range are clipped to it.
    """
    raw = np.floor(points * POSITION.one + 0.5)
    return np.asarray(np.clip(raw, POSITION.min_raw, POSITION.max_raw), dtype=np.uint16)
