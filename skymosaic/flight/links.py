"""Which photographs of a flight may overlap, and which of these pairs do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from golden_model.arrays import Matrix, Points, Records
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
"""Matches this close to the homography, but farther than a tie, show objects above the ground plane."""
NEXT_IN_ORDER = 2
NEAREST_BY_GPS = 6
MOST_ALIKE = 6
"""Number of partners that each view proposes by order, by GPS, and by similarity."""
COMPACT_FEATURES = 256
CLOSE_BITS = 0.22
"""Share of differing bits below which two features may be the same point."""
FEWEST_VOTES = 9
"""Views without common ground get 2 to 11 votes (measured)."""
FIRST_LOOK_SAMPLES = 1000
"""A third of the samples of a single pair: most candidates overlap well or not at all."""

Candidate = tuple[int, int]
"""Indices of two views, the smaller first."""


@dataclass(frozen=True, eq=False)
class Link:
    """Two views that were matched, whether they show the same ground or not.

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
    left_points: Points
    right_points: Points
    inliers: int
    near: int

    @property
    def ties(self) -> int:
        """Number of ties."""
        return len(self.left_points)

    @property
    def holds(self) -> bool:
        """Whether the views are linked."""
        return self.ties > 0

    def packed(self) -> Arrays:
        """The link as arrays for a file, without the indices, which are valid for one list of photographs only."""
        counts = np.array([self.inliers, self.near])
        return {"left_points": self.left_points, "right_points": self.right_points, "counts": counts}


def unpacked(arrays: Arrays, left: int, right: int) -> Link:
    """The link that `Link.packed` put into arrays."""
    inliers, near = arrays["counts"].tolist()
    left_points, right_points = (arrays[side].astype(np.float64) for side in ("left_points", "right_points"))
    return Link(left, right, left_points, right_points, inliers, near)


@dataclass(frozen=True)
class PairEstimator:
    """How two views are matched and their homography is estimated.

    Attributes
    ----------
    config : Config
        What the features were computed with.
    seed : int
        Of the robust estimator. The same for every pair, so that a link does not depend on which others are tried.
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
    estimate = estimate_homography(
        left_points, right_points, weight, rng=rng, max_samples=estimator.max_samples, restarts=1
    )
    inliers = int(np.count_nonzero(estimate.inliers))
    if estimate.homography is None:
        return Link(*pair, left_points[:0], right_points[:0], inliers, 0)
    return link_of(pair, left_points, right_points, estimate.homography, inliers)


def link_of(pair: Candidate, left_points: Points, right_points: Points, homography: Matrix, inliers: int) -> Link:
    """The link of two views whose homography is known: matches close to it become ties.

    Parameters
    ----------
    pair : (int, int)
    left_points, right_points : ndarray of float64, shape (N, 2)
        The matches, in working px.
    homography : ndarray of float64, shape (3, 3)
        Left to right working px.
    inliers : int
        Matches within 2 px of it.
    """
    error_px = np.linalg.norm(apply(homography, left_points) - right_points, axis=1)
    ties = error_px <= TIE_PX
    return Link(*pair, left_points[ties], right_points[ties], inliers, int(np.count_nonzero(error_px <= RELIEF_PX)))


def first_candidates(views: Sequence[View], votes: NDArray[np.int64]) -> set[Candidate]:
    """Pairs to try before a layout exists: by order, by GPS, and by `votes`."""
    pairs = [(i, i + step) for step in range(1, NEXT_IN_ORDER + 1) for i in range(len(views) - step)]
    pairs += _nearest_by_gps(views)
    for i, row in enumerate(votes):
        alike = np.argsort(-row, kind="stable")[:MOST_ALIKE]
        pairs += [(i, int(j)) for j in alike if row[j] >= FEWEST_VOTES]
    return {(min(pair), max(pair)) for pair in pairs}


def _nearest_by_gps(views: Sequence[View]) -> list[Candidate]:
    known = [(i, view.gps) for i, view in enumerate(views) if view.gps is not None]
    if len(known) < 2:
        return []
    metres = np.array([gps.metres_from(known[0][1]) for _, gps in known])
    _, nearest = KDTree(metres).query(metres, k=min(NEAREST_BY_GPS + 1, len(known)))
    return [(known[row][0], known[other][0]) for row, others in enumerate(nearest) for other in others if other != row]


def compact(features: Records) -> Records:
    """The 256 strongest features of a view, few enough to compare every view with every other."""
    strongest = np.argsort(-features["response"].astype(np.int64), kind="stable")[:COMPACT_FEATURES]
    chosen: Records = features[strongest]
    return chosen


def votes(one: Records, others: Sequence[Records]) -> list[int]:
    """Number of close mutual matches that agree on a relative orientation, for ``one`` against each of ``others``."""
    return [_agreeing(one, other) for other in others]


def _agreeing(left: Records, right: Records) -> int:
    bits = 8 * left["descriptor"].shape[1]
    left_index, right_index, best, _ = mutual_matches(distances(left["descriptor"], right["descriptor"]), bits)
    close = best <= CLOSE_BITS * bits
    relative_orientation = (right["sector"][right_index[close]] - left["sector"][left_index[close]]) % SECTORS
    histogram = np.bincount(relative_orientation, minlength=SECTORS)
    return int((histogram + np.roll(histogram, 1) + np.roll(histogram, -1)).max())
