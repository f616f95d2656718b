"""Runs every experiment on every pair."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from skymosaic.thesis.corners import by_quality, by_threshold
from skymosaic.thesis.dataset import DatasetPair, Source
from skymosaic.thesis.matches import by_rings, by_window
from skymosaic.thesis.measurements import Line, Measurement, Measurements
from skymosaic.thesis.mosaics import by_preset
from skymosaic.thesis.rejection import DESCRIPTORS, by_aerial_preset, by_fuzzy_ransac
from skymosaic.thesis.scales import by_reduction

EXPERIMENTS: tuple[Callable[[DatasetPair], Iterator[Line]], ...] = (
    by_threshold,
    by_quality,
    by_window,
    by_rings,
    by_fuzzy_ransac,
    by_aerial_preset,
    by_reduction,
    by_preset,
)


def measure(sources: Iterable[Source]) -> Measurements:
    """Load each pair in turn and run all `EXPERIMENTS` on it."""
    lines = []
    for load in sources:
        pair = load()
        for experiment in EXPERIMENTS:
            for table, setting, values in experiment(pair):
                lines.append(Measurement(table, setting, pair.name, pair.group, values))
    return Measurements(lines)


def most_inliers(measurements: Measurements) -> int:
    """Index of the pair on which the thesis's own combination finds the most inliers: a good one to show."""
    setting = next(iter(DESCRIPTORS))
    return int(np.argmax(measurements.values("IV-4", setting, "inliers")))
