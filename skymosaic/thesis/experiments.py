"""Every experiment, on every pair: tables IV-1 to IV-7, figure IV-6, and what the fuzzy stages do."""

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Mask, Pixels, Points, Records
from golden_model.config import PRESETS, MatcherConfig, Preset
from golden_model.feature.ilbp import PATTERNS
from golden_model.matching.correlation import best_matches
from golden_model.matching.matcher import match
from skymosaic.common.errors import RegistrationError
from skymosaic.evaluation.metrics import confusion, correct_matches, grid_error, repeatability, rmse
from skymosaic.features.descriptors import WINDOWS_PX, describe
from skymosaic.features.detectors import detect, keep_one_per_position, key_point_positions, to_key_points
from skymosaic.features.matchers import match_by_correlation
from skymosaic.features.methods import HostBackend, choose_method
from skymosaic.features.positions import feature_points, match_points
from skymosaic.geometry import estimators, fuzzy_ransac
from skymosaic.geometry.estimators import estimate_by_opencv
from skymosaic.geometry.homography import resize_matrix
from skymosaic.mosaicking.api import mosaic
from skymosaic.registration.register import register
from skymosaic.thesis.corners import CORNERS, detect_strongest, measure_adaptive_threshold, measure_corners
from skymosaic.thesis.dataset import DatasetPair, Source
from skymosaic.thesis.measurements import Line, Measurement, Measurements
from skymosaic.thesis.published import PUBLISHED

FUZZY_ILBP = MatcherConfig(rule_base="ilbp", keep_above=127)
MAX_ERROR_PX = 5.0
"""A pair counts as registered if the mean error over the overlap is smaller."""
KEY_POINTS = 300
"""SIFT key points per image; the thesis had 152 to 403."""
DESCRIPTORS = {"SIFT + ILBP, N = 4": "thesis-ilbp-4", "SIFT + ILBP-128": "ilbp-128", "SIFT + SIFT": "sift"}
"""The thesis's combination, then the same with our descriptor and with SIFT's own."""
STAGES = {name: f"fuzzy RANSAC, {name}" for name in DESCRIPTORS}
OURS = "aerial preset"
REDUCTIONS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0)
TOLERANCE_PX = 1.5
"""Maximum distance of corresponding key points, in pixels of the reduced picture (Schmid, Mohr, Bauckhage 2000)."""
CHANCE_SHIFT_PX = 12.0
"""Key points that agree after the reduced picture is shifted by this distance agree by chance."""
DETECTORS: dict[str, Callable[[Pixels, int], NDArray[np.floating]]] = {
    "SIFT": lambda gray, count: key_point_positions(keep_one_per_position(detect(gray, "sift", count))[:count]),
    "Harris": lambda gray, count: feature_points(detect_strongest(gray, count)),
}
TIMED: dict[str, Preset] = {"thesis preset": "thesis", "aerial preset": "aerial"}


def measure_windows(pair: DatasetPair) -> Iterator[Line]:
    """Count mutual SAD matches of windows of each size (Table IV-2), and those that fuzzy correlation keeps.

    The time is processor time for cutting out the windows and finding the golden model's best SAD match of each left
    window.
    """
    key_points = [to_key_points(detect_strongest(gray)) for gray in pair.grays]
    for name, size_px in WINDOWS_PX.items():
        start = time.process_time()
        left, right = (describe(gray, points, name) for gray, points in zip(pair.grays, key_points, strict=True))
        best_matches(left["descriptor"], right["descriptor"], "sad")
        seconds = time.process_time() - start
        matches = match_by_correlation(left, right)
        yield "IV-2", str(size_px), _count_good(pair, matches, seconds)
        kept = np.asarray(matches["verdict"] == 1)
        yield measure_stage(f"fuzzy correlation, {size_px}x{size_px}", pair, match_points(matches), kept)


def measure_rings(pair: DatasetPair) -> Iterator[Line]:
    """Count mutual Hamming matches of the ILBP of each length (Table IV-3), and those that fuzzy ILBP keeps."""
    for rings in PUBLISHED.settings("IV-3"):
        name = f"thesis-ilbp-{rings}"
        features = [detect_strongest(gray, descriptor=name) for gray in pair.grays]
        start = time.process_time()
        matches = match(features[0], features[1], PATTERNS[name], FUZZY_ILBP)
        seconds = time.process_time() - start
        yield "IV-3", rings, _count_good(pair, matches, seconds)
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
        "registered before": is_registered(estimate_by_opencv("ransac", *points), pair),
        "registered after": is_registered(estimate_by_opencv("ransac", points[0][kept], points[1][kept]), pair),
    }
    return "stages", stage, values


def is_registered(H: Array | None, pair: DatasetPair) -> bool:
    """Whether the mean error over the overlap is below `MAX_ERROR_PX`."""
    return grid_error(H, pair.truth, *pair.sizes) < MAX_ERROR_PX


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


def measure_seconds(pair: DatasetPair) -> Iterator[Line]:
    """Measure the processor time from two decoded images to their mosaic, by either preset (Table IV-7).

    A pair that cannot be registered has no time.
    """
    for setting, preset in TIMED.items():
        start = time.process_time()
        try:
            mosaic([pair.left, pair.right], preset=preset)
        except RegistrationError:
            continue
        yield "IV-7", setting, {"whole": time.process_time() - start}


EXPERIMENTS: tuple[Callable[[DatasetPair], Iterator[Line]], ...] = (
    measure_corners,
    measure_adaptive_threshold,
    measure_windows,
    measure_rings,
    measure_fuzzy_ransac,
    measure_aerial_preset,
    measure_repeatability,
    measure_seconds,
)


def run_experiments(sources: Iterable[Source]) -> Measurements:
    """Load each pair in turn and run all `EXPERIMENTS` on it."""
    lines = []
    for load in sources:
        pair = load()
        for experiment in EXPERIMENTS:
            for table, setting, values in experiment(pair):
                lines.append(Measurement(table, setting, pair.name, pair.group, values))
    return Measurements(lines)


def find_best_pair(measurements: Measurements) -> int:
    """Find the pair on which the thesis's own combination has the most inliers, a good one to show; its index."""
    setting = next(iter(DESCRIPTORS))
    return int(np.argmax(measurements.values("IV-4", setting, "inliers")))
