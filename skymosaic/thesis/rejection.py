"""Fuzzy RANSAC on SIFT key points: how many matches pass each check, RMSE, recall and precision (IV-4 to IV-6)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from golden_model.arrays import Array, Points
from golden_model.config import PRESETS, MatcherConfig
from skymosaic.evaluation.metrics import grid_error, rmse
from skymosaic.features.methods import HostBackend, choose
from skymosaic.features.positions import match_points
from skymosaic.geometry import estimators, fuzzy_ransac
from skymosaic.registration import register
from skymosaic.thesis.dataset import Specimen
from skymosaic.thesis.matches import filtered, is_registered
from skymosaic.thesis.measurements import Line

KEY_POINTS = 300
"""SIFT key points an image; the thesis had 152 to 403."""
DESCRIPTORS = {"SIFT + ILBP, N = 4": "thesis-ilbp-4", "SIFT + ILBP-128": "ilbp-128", "SIFT + SIFT": "sift"}
"""The thesis's combination, ours in its place, and SIFT's own."""
STAGES = {name: f"fuzzy RANSAC, {name}" for name in DESCRIPTORS}
OURS = "aerial preset"


def by_fuzzy_ransac(specimen: Specimen) -> Iterator[Line]:
    """Tables IV-4 to IV-6: every check of fuzzy RANSAC on every match, behind each descriptor."""
    base = PRESETS["aerial"]
    base = dataclasses.replace(
        base,
        front_end=dataclasses.replace(base.front_end, max_features=KEY_POINTS),
        matcher=MatcherConfig(rule_base="none"),
    )
    for setting, descriptor in DESCRIPTORS.items():
        method, config = choose(base, "sift", descriptor)
        left, right = HostBackend(method).run([specimen.left, specimen.right], config)
        pairs, verified = match_points(right.matches), right.matches["verdict"] == 1
        H, decision = estimators.fuzzy(*pairs, verified)
        rule = np.full(len(verified), -1) if decision is None else decision.rule
        inliers = np.isin(rule, fuzzy_ransac.INLIER_RULES)
        yield (
            "IV-4",
            setting,
            {
                "features 1": len(left.features),
                "features 2": len(right.features),
                "matched": len(verified),
                "bidirectional": int(verified.sum()),
                "RANSAC": int(np.isin(rule, fuzzy_ransac.NEAR_RULES).sum()),
                "inliers": int(inliers.sum()),
            },
        )
        yield filtered(STAGES[setting], specimen, pairs, inliers)
        yield _error(setting, specimen, H, (pairs[0][inliers], pairs[1][inliers]))


def by_aerial_preset(specimen: Specimen) -> Iterator[Line]:
    """The same measures of the project's own preset."""
    pair = register(specimen.left, specimen.right)
    yield filtered(f"{OURS}, 8 rules", specimen, match_points(pair.matches), pair.matches["verdict"] == 1)
    yield _error(OURS, specimen, pair.homography, match_points(pair.inliers))


def _error(setting: str, specimen: Specimen, H: Array | None, inliers: tuple[Points, Points]) -> Line:
    """RMSE over the inliers as the thesis takes it, and the distance from the truth, where the pair was registered."""
    if H is None or not is_registered(H, specimen):
        return "IV-5", setting, {"registered": 0}
    error_px = grid_error(H, specimen.truth, *specimen.sizes)
    return "IV-5", setting, {"registered": 1, "RMSE": rmse(H, *inliers), "error": error_px}
