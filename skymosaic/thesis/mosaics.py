"""Table IV-7: time from two decoded images to their mosaic."""

from __future__ import annotations

from collections.abc import Iterator

from skymosaic.errors import RegistrationError
from skymosaic.mosaicking.api import mosaic
from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.measurements import Line

PRESETS = {"thesis preset": "thesis", "aerial preset": "aerial"}


def by_preset(pair: DatasetPair) -> Iterator[Line]:
    """Seconds for a mosaic and for each of its stages, by either preset, if the pair can be registered."""
    for setting, preset in PRESETS.items():
        try:
            result = mosaic([pair.left, pair.right], preset=preset)
        except RegistrationError:
            continue
        seconds = result.pairs[0].seconds
        yield "IV-7", setting, {**seconds, "whole": sum(seconds.values())}
