"""Every table is measured, as recorded; errors of registered pairs, and what counts as registered."""

import numpy as np
import pytest

from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.experiments import _measure_error, is_registered
from skymosaic.thesis.measurements import Measurements


def test_every_table_is_measured_on_every_pair(measured: Measurements) -> None:
    assert len(measured.pairs) == 1
    everywhere = {"IV-1", "adaptive", "IV-2", "IV-3", "IV-4", "IV-5", "stages", "figure IV-6"}
    for pair in measured.pairs:
        assert everywhere <= {line.table for line in measured.lines if line.pair == pair}
    assert measured.values("IV-7", "aerial preset", "whole")


MEASURED: dict[tuple[str, str], dict[str, float]] = {
    ("IV-2", "25"): {"matches": 154, "good": 141},
    ("stages", "fuzzy correlation, 25x25"): {"TP": 50, "FP": 0, "TN": 13, "FN": 91},
    ("IV-3", "4"): {"matches": 95, "good": 25},
    ("stages", "fuzzy ILBP, N = 4"): {"TP": 25, "FP": 39, "TN": 31, "FN": 0},
    ("IV-4", "SIFT + ILBP-128"): {"features 1": 271, "matched": 99, "bidirectional": 97, "RANSAC": 95, "inliers": 95},
    ("IV-5", "SIFT + ILBP-128"): {"registered": 1, "RMSE": 0.11, "error": 0.02},
    ("IV-5", "aerial preset"): {"registered": 1, "RMSE": 0.27, "error": 0.02},
    ("figure IV-6", "SIFT 2"): {"repeatability": 0.88, "chance": 0.08},
    ("figure IV-6", "Harris 4"): {"repeatability": 0.53, "chance": 0.26},
}
"""What was recorded of the pair."""


@pytest.mark.parametrize("where", MEASURED)
def test_the_measurements_of_the_pair_are_those_recorded(measured: Measurements, where: tuple[str, str]) -> None:
    found = {each: measured.number(*where, each) for each in MEASURED[where]}
    # Another version of OpenCV finds a few other key points.
    assert found == pytest.approx(MEASURED[where], rel=0.05, abs=0.02)


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
