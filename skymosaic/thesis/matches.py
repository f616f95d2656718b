"""Good and false matches as functions of the correlation window (Table IV-2) and of the ILBP's rings (Table IV-3)."""

from collections.abc import Iterator

import numpy as np

from golden_model.arrays import Array, Mask, Points, Records
from golden_model.config import MatcherConfig
from golden_model.feature.ilbp import PATTERNS
from golden_model.matching.correlation import best_matches
from golden_model.matching.matcher import match
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.evaluation.metrics import confusion, correct_matches, grid_error
from skymosaic.features.descriptors import WINDOWS_PX, describe
from skymosaic.features.detectors import to_key_points
from skymosaic.features.matchers import match_by_correlation
from skymosaic.features.positions import match_points
from skymosaic.geometry.estimators import ransac
from skymosaic.thesis import published
from skymosaic.thesis.corners import detect_strongest
from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.measurements import Line

FUZZY_ILBP = MatcherConfig(rule_base="ilbp", keep_above=127)
MAX_ERROR_PX = 5.0
"""A pair counts as registered if the mean error over the overlap is smaller."""


def measure_windows(pair: DatasetPair) -> Iterator[Line]:
    """Count mutual SAD matches of windows of each size (Table IV-2), and those that fuzzy correlation keeps.

    The time covers cutting out the windows and finding the golden model's best SAD match of each left window.
    """
    key_points = [to_key_points(detect_strongest(gray)) for gray in pair.grays]
    for name, size_px in WINDOWS_PX.items():
        clock = Stopwatch()
        left, right = (describe(gray, points, name) for gray, points in zip(pair.grays, key_points, strict=True))
        best_matches(left["descriptor"], right["descriptor"], "sad")
        seconds = clock.lap("matching")
        matches = match_by_correlation(left, right)
        yield "IV-2", str(size_px), _count_good(pair, matches, seconds)
        kept = np.asarray(matches["verdict"] == 1)
        yield measure_stage(f"fuzzy correlation, {size_px}x{size_px}", pair, match_points(matches), kept)


def measure_rings(pair: DatasetPair) -> Iterator[Line]:
    """Count mutual Hamming matches of the ILBP of each length (Table IV-3), and those that fuzzy ILBP keeps."""
    for rings in published.ILBP:
        name = f"thesis-ilbp-{rings}"
        features = [detect_strongest(gray, descriptor=name) for gray in pair.grays]
        clock = Stopwatch()
        matches = match(features[0], features[1], PATTERNS[name], FUZZY_ILBP)
        seconds = clock.lap("matching")
        yield "IV-3", str(rings), _count_good(pair, matches, seconds)
        kept = np.asarray(matches["verdict"] == 1)
        yield measure_stage(f"fuzzy ILBP, N = {rings}", pair, match_points(matches), kept)


def _count_good(pair: DatasetPair, matches: Records, seconds: float) -> dict[str, float]:
    good = correct_matches(*match_points(matches), pair.truth)
    return {"matches": len(matches), "good": int(good.sum()), "seconds": seconds}


def measure_stage(stage: str, pair: DatasetPair, points: tuple[Points, Points], kept: Mask) -> Line:
    """Compare the matches that a fuzzy stage keeps with the truth.

    Tells also whether RANSAC registers the pair with all matches and with the kept ones.
    """
    counts = confusion(kept, correct_matches(*points, pair.truth))
    values = {
        "TP": counts.true_positives,
        "FP": counts.false_positives,
        "TN": counts.true_negatives,
        "FN": counts.false_negatives,
        "registered before": is_registered(ransac(*points), pair),
        "registered after": is_registered(ransac(points[0][kept], points[1][kept]), pair),
    }
    return "stages", stage, values


def is_registered(H: Array | None, pair: DatasetPair) -> bool:
    """Whether the mean error over the overlap is below `MAX_ERROR_PX`."""
    return grid_error(H, pair.truth, *pair.sizes) < MAX_ERROR_PX
