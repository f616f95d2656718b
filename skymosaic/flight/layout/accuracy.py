"""How far a layout is off, by matches that had no part in it.

The ties of a layout cannot see its faults: a link that contradicts it loses its weight and no longer counts, and what
lies above the ground plane is no tie. So every link keeps some of its matches aside, relief included, and those of the
links that contradict are counted with the others.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from golden_model.arrays import Array
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.geometry.homography import transfer_error

Key = TypeVar("Key")
MIN_CHECKS = 5
"""The median of fewer matches says too little about a photograph or a pair to name it."""


@dataclass(frozen=True)
class Errors:
    """Median and 90th percentile of distances between matches under a layout, in working px of the right view."""

    matches: int
    median_px: float
    ninety_px: float


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of the matches that a layout did not use."""

    whole: Errors
    photographs: dict[int, Errors]
    """By view, the worst first, without those of few matches."""
    pairs: dict[Candidate, Errors]
    """By the two views, likewise."""


def measure_accuracy(transforms: Mapping[int, Array], links: Iterable[Link]) -> Accuracy | None:
    """Measure a layout by all links between its views, those that contradict it included; None if none has checks."""
    by_pair: dict[Candidate, list[Array]] = {}
    by_view: dict[int, list[Array]] = {}
    for link in links:
        if len(link.left_checks):
            between = np.linalg.inv(transforms[link.right]) @ transforms[link.left]
            error_px = transfer_error(between, link.left_checks, link.right_checks)
            by_pair[link.left, link.right] = [error_px]
            for view in (link.left, link.right):
                by_view.setdefault(view, []).append(error_px)
    if not by_pair:
        return None
    whole = _summarise([error_px for errors in by_pair.values() for error_px in errors])
    return Accuracy(whole, _worst_first(by_view), _worst_first(by_pair))


def _summarise(parts: list[Array]) -> Errors:
    errors_px = np.concatenate(parts)
    median_px, ninety_px = np.percentile(errors_px, (50, 90)).tolist()
    return Errors(len(errors_px), median_px, ninety_px)


def _worst_first(parts: Mapping[Key, list[Array]]) -> dict[Key, Errors]:
    errors = {key: _summarise(each) for key, each in parts.items()}
    enough = [(key, each) for key, each in errors.items() if each.matches >= MIN_CHECKS]
    return dict(sorted(enough, key=lambda item: -item[1].median_px))
