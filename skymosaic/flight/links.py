"""Which photographs of a flight may overlap, and which of these pairs really do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from golden_model.arrays import Array, Records
from golden_model.config import Config
from golden_model.feature.ilbp import SECTORS
from golden_model.matching.hamming import distances, mutual_matches
from golden_model.matching.matcher import match
from skymosaic.features.positions import match_points
from skymosaic.flight.cache import Arrays
from skymosaic.flight.view import View
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import estimate_homography

TIE_PX = 3.0
"""Matches this close to a pair's homography tie the two views together, in working pixels."""
RELIEF_PX = 12.0
"""Matches this close to it, but no ties, show something that stands out of the ground."""
NEXT_IN_ORDER = 2
NEAREST_BY_GPS = 6
MOST_ALIKE = 6
"""Partners each view proposes by each of these criteria."""
COMPACT_FEATURES = 256
CLOSE_BITS = 0.22
"""Share of differing bits below which two features may be the same point."""
FEWEST_VOTES = 9
"""Views that have nothing in common get up to about as many (measured: 2 to 11)."""
FIRST_LOOK_SAMPLES = 1000
"""A third of a single pair's: most candidates overlap well or not at all."""

Candidate = tuple[int, int]
"""Indices of two views, the smaller first."""


@dataclass(frozen=True, eq=False)
class Link:
    """Two views that show the same ground, or were tried.

    Attributes
    ----------
    left, right : int
        Indices of the views, left < right.
    left_points, right_points : ndarray of float64, shape (N, 2)
        The ties: matches within 3 working px of the pair's homography; none where the views are not linked.
    inliers : int
        Matches within 2 px of the best homography that was found.
    near : int
        Matches within 12 px of it.
    """

    left: int
    right: int
    left_points: Array
    right_points: Array
    inliers: int
    near: int

    @property
    def ties(self) -> int:
        """How many there are."""
        return len(self.left_points)

    @property
    def holds(self) -> bool:
        """Whether the views are linked."""
        return self.ties > 0

    def packed(self) -> Arrays:
        """The link as arrays for a file, without the indices: they belong to one list of photographs."""
        counts = np.array([self.inliers, self.near])
        return {"left_points": self.left_points, "right_points": self.right_points, "counts": counts}


def unpacked(arrays: Arrays, left: int, right: int) -> Link:
    """The link that `Link.packed` put into arrays."""
    inliers, near = arrays["counts"].tolist()
    left_points, right_points = (arrays[side].astype(np.float64) for side in ("left_points", "right_points"))
    return Link(left, right, left_points, right_points, inliers, near)


@dataclass(frozen=True)
class PairEstimator:
    """How two views are matched and their homography is sought.

    Attributes
    ----------
    config : Config
        What the features were computed with.
    seed : int
        Of the robust estimator, the same for every pair: a link does not depend on which others are tried.
    max_samples : int
        Of the robust estimator.
    """

    config: Config
    seed: int
    max_samples: int = FIRST_LOOK_SAMPLES


def verify(estimator: PairEstimator, pair: Candidate, left: Records, right: Records) -> Link:
    """Match the features of two views and fit a homography."""
    config = estimator.config
    matches = match(left, right, config.front_end.pattern, config.matcher)
    kept = matches[matches["verdict"] == 1]
    left_points, right_points = match_points(kept)
    weight = kept["weight"].astype(np.float64)
    rng = np.random.default_rng(estimator.seed)
    estimate = estimate_homography(left_points, right_points, weight, rng=rng, max_samples=estimator.max_samples)
    inliers = int(np.count_nonzero(estimate.inliers))
    if estimate.homography is None:
        return Link(*pair, left_points[:0], right_points[:0], inliers, 0)
    error = np.linalg.norm(apply(estimate.homography, left_points) - right_points, axis=1)
    ties = error <= TIE_PX
    return Link(*pair, left_points[ties], right_points[ties], inliers, int(np.count_nonzero(error <= RELIEF_PX)))


def first_candidates(views: Sequence[View], votes: NDArray[np.int64]) -> set[Candidate]:
    """Pairs worth a try before anything is known of the layout: by order, by GPS, and by `votes`."""
    pairs = [(i, i + step) for step in range(1, NEXT_IN_ORDER + 1) for i in range(len(views) - step)]
    pairs += _nearest_by_gps(views)
    for i, row in enumerate(votes):
        alike = np.argsort(-row, kind="stable")[:MOST_ALIKE]
        pairs += [(i, int(j)) for j in alike if row[j] >= FEWEST_VOTES]
    return {(min(pair), max(pair)) for pair in pairs}


def _nearest_by_gps(views: Sequence[View]) -> list[Candidate]:
    known = [(i, view.place) for i, view in enumerate(views) if view.place is not None]
    if len(known) < 2:
        return []
    metres = np.array([place.metres_from(known[0][1]) for _, place in known])
    _, nearest = KDTree(metres).query(metres, k=min(NEAREST_BY_GPS + 1, len(known)))
    return [(known[row][0], known[other][0]) for row, others in enumerate(nearest) for other in others if other != row]


def compact(features: Records) -> Records:
    """The strongest features of a view, few enough to compare every view with every other."""
    strongest = np.argsort(-features["response"].astype(np.int64), kind="stable")[:COMPACT_FEATURES]
    chosen: Records = features[strongest]
    return chosen


def votes(one: Records, others: Sequence[Records]) -> list[int]:
    """How many close mutual matches of compact feature sets agree on a turn, for ``one`` against each of others."""
    return [_agreeing(one, other) for other in others]


def _agreeing(left: Records, right: Records) -> int:
    bits = 8 * left["descriptor"].shape[1]
    left_index, right_index, best, _ = mutual_matches(distances(left["descriptor"], right["descriptor"]), bits)
    close = best <= CLOSE_BITS * bits
    turn = (right["sector"][right_index[close]] - left["sector"][left_index[close]]) % SECTORS
    histogram = np.bincount(turn, minlength=SECTORS)
    return int((histogram + np.roll(histogram, 1) + np.roll(histogram, -1)).max())
