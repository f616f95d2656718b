"""Links of a flight: pairs of photographs that show the same ground, with their common points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Matrix, Points, Records
from golden_model.config import Config
from golden_model.matching.matcher import match
from skymosaic.features.positions import match_points
from skymosaic.flight.cache import Arrays
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import estimate_homography

TIE_PX = 3.0
"""Matches this close to a pair's homography tie the two views together, in working pixels."""
RELIEF_PX = 12.0
"""Matches this close to the homography, but farther than a tie, show objects above the ground plane."""
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


def holding(links: Mapping[Candidate, Link]) -> list[Link]:
    """The links that hold."""
    return [link for link in links.values() if link.holds]


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
