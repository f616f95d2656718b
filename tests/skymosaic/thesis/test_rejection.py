"""Errors of registered pairs, and what counts as registered."""

from dataclasses import replace

import numpy as np
import pytest

from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.matches import is_registered, measure_stage
from skymosaic.thesis.rejection import _measure_error


def moved(pair: DatasetPair, shift_px: float) -> np.ndarray:
    return np.array([[1.0, 0, shift_px], [0, 1, 0], [0, 0, 1]]) @ pair.truth


@pytest.mark.parametrize(("shift_px", "registered"), [(0.0, 1), (-4.9, 1), (5.1, 0), (None, 0)])
def test_a_homography_within_five_pixels_is_measured(
    pair: DatasetPair, shift_px: float | None, registered: int
) -> None:
    H = None if shift_px is None else moved(pair, shift_px)
    assert is_registered(H, pair) == bool(registered)
    ends = np.array([[100.0, 90], [300, 200]]), np.array([[100.0, 90], [300, 200]])
    table, setting, values = _measure_error("ours", pair, H, ends)
    assert (table, setting, values["registered"]) == ("IV-5", "ours", registered)
    if registered:
        assert values["error"] == pytest.approx(abs(shift_px or 0), abs=0.01)
    else:
        assert values == {"registered": 0}


def test_a_stage_is_held_against_the_truth(pair: DatasetPair) -> None:
    """Two of ten matches are wrong; one of these and seven of the others are kept."""
    pair = replace(pair, truth=np.eye(3))
    left = np.random.default_rng(1).uniform(50, 400, (10, 2))
    right = left + np.array([[0.5, 0]] * 8 + [[40, 0], [0, -60]])
    kept = np.array([*[True] * 7, False, True, False])
    _, _, values = measure_stage("fuzzy", pair, (left, right), kept)
    assert values == {"TP": 7, "FP": 1, "TN": 1, "FN": 1, "registered before": True, "registered after": True}
    _, _, values = measure_stage("fuzzy", pair, (left, right), ~kept)
    assert values == {"TP": 1, "FP": 1, "TN": 1, "FN": 7, "registered before": True, "registered after": False}
