"""A pair in numbers and pictures: which matches count as inliers, and what is told of a pair that is refused."""

from dataclasses import replace

import numpy as np
import pytest

from golden_model.records import MATCH
from sim.scene import make_pair
from skymosaic import register
from skymosaic.registration.pair import Pair

SHIFT = np.array([[1.0, 0, -40], [0, 1, 0], [0, 0, 1]])


@pytest.fixture(scope="module")
def pair() -> Pair:
    left, right = make_pair(seed=5, size=(320, 240)).images
    return register(left, right, effort="fast")


def test_inliers_are_counted_anew_up_to_two_pixels(pair: Pair) -> None:
    kept = np.zeros(5, MATCH.dtype)
    kept["left_x"], kept["left_y"] = 16 * np.array([50, 60, 70, 80, 90]), 16 * 100
    kept["right_x"] = kept["left_x"] - 16 * 40 + [0, 32, 33, 0, 0]
    kept["right_y"] = 16 * 100 + np.array([0, 0, 0, 32, 33])
    moved = replace(pair, kept=kept, to_original=(np.diag([2.0, 2, 1]), np.eye(3))).with_homography(SHIFT, 7)
    assert moved.inliers["left_x"].tolist() == [800, 960, 1280]
    assert moved.refined_inliers == 7
    assert moved.homography == pytest.approx(SHIFT @ np.diag([0.5, 0.5, 1]))
    assert moved.working_homography == pytest.approx(SHIFT)
    table = moved.table("kept")
    assert table["left_x"].tolist() == [100, 120, 140, 160, 180]
    assert table["error_px"] == pytest.approx([0, 2, 33 / 16, 2, 33 / 16])


def test_all_of_a_pair_is_told_whether_it_is_accepted_or_not(pair: Pair) -> None:
    trust = pair.confidence
    assert trust is not None
    assert pair.homography is not None
    row, refused = pair.row(), pair.refused("too far").row()
    counts = {
        "left": "left image", "right": "right image", "left_features": len(pair.features[0]),
        "right_features": len(pair.features[1]), "matches": len(pair.matches), "kept": len(pair.kept),
        "inliers": len(pair.inliers), "refined_inliers": 0, "passes": 1, "inverted": False,
    }  # fmt: skip
    assert row | counts == row
    assert refused | counts == refused
    judged = [[each[name] for name in ("accepted", "reason", "verdict", "predicted_px")] for each in (row, refused)]
    assert judged == [[True, "", trust.verdict, trust.predicted_px], [False, "too far", "", None]]
    assert [row[f"h{i}{j}"] for i in (1, 2, 3) for j in (1, 2, 3)] == pair.homography.ravel().tolist()
    assert row["seconds"] == sum(pair.seconds.values())
    names = ("homography", "confidence", "preset", "detector", "descriptor", "estimator", "effort", "backend")
    told = [pair.refused("").summary()[name] for name in names]
    assert told == [None, None, "aerial", "harris", "ilbp-128", "prosac", "fast", "golden"]


def test_known_evidence_is_that_of_its_homography(pair: Pair) -> None:
    bare = pair.without_pixels()
    assert bare.confidence == pair.confidence is not None
    assert bare.with_homography(SHIFT, 0).known_evidence is None
    assert bare.refused("too far").confidence is None
