"""Links of a flight: pairs of photographs that show the same ground, with their common points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from golden_model.arrays import Matrix, Points, Records
from golden_model.config import Config
from golden_model.matching.matcher import match
from skymosaic.features.positions import match_points
from skymosaic.features.standing import are_still, stands_on_still_parts
from skymosaic.flight.cache import Arrays
from skymosaic.geometry.homography import transfer_error
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
        Matches within 2 px of the best homography.
    near : int
        Matches within 12 px of it.
    standing : bool
        Matches that moved with the camera were left out.
    """

    left: int
    right: int
    left_points: Points
    right_points: Points
    inliers: int
    near: int
    standing: bool = False

    @property
    def ties(self) -> int:
        """Number of ties."""
        return len(self.left_points)

    @property
    def holds(self) -> bool:
        """Whether the views are linked."""
        return self.ties > 0

    def pack(self) -> Arrays:
        """Turn the link into arrays for a file, without the indices, which are valid for one list of views only."""
        counts = np.array([self.inliers, self.near, self.standing])
        return {"left_points": self.left_points, "right_points": self.right_points, "counts": counts}

    @classmethod
    def unpack(cls, arrays: Arrays, left: int, right: int) -> Link:
        """Read the link that `pack` turned into arrays."""
        inliers, near, standing = arrays["counts"].tolist()
        left_points, right_points = (arrays[side].astype(np.float64) for side in ("left_points", "right_points"))
        return cls(left, right, left_points, right_points, inliers, near, bool(standing))


def valid_links(links: Mapping[Candidate, Link]) -> list[Link]:
    """The links that hold."""
    return [link for link in links.values() if link.holds]


def link_views(
    pair: Candidate,
    left: Records,
    right: Records,
    *,
    config: Config,
    seed: int,
    max_samples: int = FIRST_LOOK_SAMPLES,
) -> Link:
    """Match the features of two views and fit a homography.

    Parameters
    ----------
    pair : (int, int)
    left, right : structured ndarray
        Feature records.
    config : Config
        The configuration by which the features were computed.
    seed : int
        Seed of the robust estimator. The same for every pair, so that no link depends on which others are tried.
    max_samples : int
        Samples of the robust estimator, at most.
    """
    matches = match(left, right, config.front_end.pattern, config.matcher)
    accepted = matches[matches["verdict"] == 1]
    left_points, right_points = match_points(accepted)
    weight = accepted["weight"].astype(np.float64)
    rng = np.random.default_rng(seed)
    # One search: a link that it misses is made up for by the others, which the layout predicts.
    estimate = estimate_homography(left_points, right_points, weight, rng=rng, max_samples=max_samples, restarts=1)
    standing = estimate.homography is not None and stands_on_still_parts(
        left_points[estimate.inliers], right_points[estimate.inliers], (left, right)
    )
    if standing:
        moving = ~are_still(left_points, right_points)
        left_points, right_points, weight = left_points[moving], right_points[moving], weight[moving]
        estimate = estimate_homography(left_points, right_points, weight, rng=rng, max_samples=max_samples, restarts=1)
    inliers = int(np.count_nonzero(estimate.inliers))
    if estimate.homography is None:
        return Link(*pair, left_points[:0], right_points[:0], inliers, near=0, standing=standing)
    return replace(tie_views(pair, left_points, right_points, estimate.homography, inliers), standing=standing)


def tie_views(pair: Candidate, left_points: Points, right_points: Points, homography: Matrix, inliers: int) -> Link:
    """Link two views by their matches that a known homography explains.

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
    error_px = transfer_error(homography, left_points, right_points)
    is_tie = error_px <= TIE_PX
    near = int(np.count_nonzero(error_px <= RELIEF_PX))
    return Link(*pair, left_points[is_tie], right_points[is_tie], inliers, near)
