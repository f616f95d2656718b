"""Runs every experiment on every pair, the time for a mosaic (Table IV-7) among them."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from golden_model.config import Preset
from skymosaic.common.errors import RegistrationError
from skymosaic.mosaicking.api import mosaic
from skymosaic.thesis.corners import measure_adaptive_threshold, measure_corners
from skymosaic.thesis.dataset import DatasetPair, Source
from skymosaic.thesis.matches import measure_rings, measure_windows
from skymosaic.thesis.measurements import Line, Measurement, Measurements
from skymosaic.thesis.rejection import DESCRIPTORS, measure_aerial_preset, measure_fuzzy_ransac
from skymosaic.thesis.scales import measure_repeatability

PRESETS: dict[str, Preset] = {"thesis preset": "thesis", "aerial preset": "aerial"}


def measure_seconds(pair: DatasetPair) -> Iterator[Line]:
    """Measure the time from two decoded images to their mosaic, and of each stage, by either preset (Table IV-7).

    A pair that cannot be registered has no time.
    """
    for setting, preset in PRESETS.items():
        try:
            result = mosaic([pair.left, pair.right], preset=preset)
        except RegistrationError:
            continue
        seconds = result.pairs[0].seconds
        yield "IV-7", setting, {**seconds, "whole": sum(seconds.values())}


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
