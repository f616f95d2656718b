import pytest

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
    ("IV-4", "SIFT + ILBP-128"): {"features 1": 271, "matched": 99, "bidirectional": 97, "RANSAC": 95, "inliers": 95},
    ("IV-5", "SIFT + ILBP-128"): {"registered": 1, "RMSE": 0.11, "error": 0.02},
    ("IV-5", "aerial preset"): {"registered": 1, "RMSE": 0.27, "error": 0.02},
    ("figure IV-6", "SIFT 2"): {"repeatability": 0.88, "chance": 0.08},
    ("figure IV-6", "Harris 4"): {"repeatability": 0.53, "chance": 0.26},
}
"""What was recorded of the pair."""


@pytest.mark.parametrize("where", MEASURED)
def test_the_measurements_of_the_pair_are_those_recorded(measured: Measurements, where: tuple[str, str]) -> None:
    found = {each: measured.mean(*where, each) for each in MEASURED[where]}
    # Another version of OpenCV finds a few other key points.
    assert found == pytest.approx(MEASURED[where], rel=0.05, abs=0.02)
