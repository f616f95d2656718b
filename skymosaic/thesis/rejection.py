"""Fuzzy RANSAC on SIFT key points: matches that pass each check, RMSE, recall and precision (tables IV-4 to IV-6)."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from golden_model.arrays import Array, Points
from golden_model.config import PRESETS, MatcherConfig
from skymosaic.evaluation.metrics import grid_error, rmse
from skymosaic.features.methods import HostBackend, choose_method
from skymosaic.features.positions import match_points
from skymosaic.geometry import estimators, fuzzy_ransac
from skymosaic.registration.register import register
from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.matches import is_registered, measure_stage
from skymosaic.thesis.measurements import Line

KEY_POINTS = 300
"""SIFT key points per image; the thesis had 152 to 403."""
DESCRIPTORS = {"SIFT + ILBP, N = 4": "thesis-ilbp-4", "SIFT + ILBP-128": "ilbp-128", "SIFT + SIFT": "sift"}
"""The thesis's combination, then the same with our descriptor and with SIFT's own."""
STAGES = {name: f"fuzzy RANSAC, {name}" for name in DESCRIPTORS}
OURS = "aerial preset"


def measure_fuzzy_ransac(pair: DatasetPair) -> Iterator[Line]:
    """Apply every check of fuzzy RANSAC to every match, for each descriptor (Tables IV-4 to IV-6)."""
    base = PRESETS["aerial"]
    base = dataclasses.replace(
        base,
        front_end=dataclasses.replace(base.front_end, max_features=KEY_POINTS),
        matcher=MatcherConfig(rule_base="none"),
    )
    for setting, descriptor in DESCRIPTORS.items():
        method, config = choose_method(base, "sift", descriptor)
        left, right = HostBackend(method).run([pair.left, pair.right], config)
        points, verified = match_points(right.matches), right.matches["verdict"] == 1
        H, decision = estimators.fuzzy(*points, verified)
        rule = np.full(len(verified), -1) if decision is None else decision.rule
        inliers = np.isin(rule, fuzzy_ransac.INLIER_RULES)
        counts = {
            "features 1": len(left.features),
            "features 2": len(right.features),
            "matched": len(verified),
            "bidirectional": int(verified.sum()),
            "RANSAC": int(np.isin(rule, fuzzy_ransac.NEAR_RULES).sum()),
            "inliers": int(inliers.sum()),
        }
        yield "IV-4", setting, counts
        yield measure_stage(STAGES[setting], pair, points, inliers)
        yield _measure_error(setting, pair, H, (points[0][inliers], points[1][inliers]))


def measure_aerial_preset(pair: DatasetPair) -> Iterator[Line]:
    """Measure the project's own preset in the same way."""
    registered = register(pair.left, pair.right)
    kept = registered.matches["verdict"] == 1
    yield measure_stage(f"{OURS}, 8 rules", pair, match_points(registered.matches), kept)
    yield _measure_error(OURS, pair, registered.homography, match_points(registered.inliers))


def _measure_error(setting: str, pair: DatasetPair, H: Array | None, inliers: tuple[Points, Points]) -> Line:
    """RMSE over the inliers as in the thesis, and the mean distance from the truth, if the pair was registered."""
    if H is None or not is_registered(H, pair):
        return "IV-5", setting, {"registered": 0}
    error_px = grid_error(H, pair.truth, *pair.sizes)
    return "IV-5", setting, {"registered": 1, "RMSE": rmse(H, *inliers), "error": error_px}
