"""Links of a flight: pairs of photographs that show the same ground, with their common points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from golden_model.arrays import Array, Matrix, Points, Records
from golden_model.cache import Arrays
from golden_model.config import Config
from golden_model.formats import WEIGHT
from golden_model.matching import hamming
from golden_model.matching.matcher import match
from skymosaic.features.positions import feature_points, match_points
from skymosaic.geometry.ground import LeftOut, Sight, find_ground
from skymosaic.geometry.homography import apply, transfer_error
from skymosaic.geometry.prosac import Estimate, estimate_homography

TIE_PX = 3.0
"""Matches this close to a pair's homography tie the two views together, in working pixels."""
RELIEF_PX = 12.0
"""Matches this close to the homography, but farther than a tie, show objects above the ground plane."""
EPIPOLAR_PX, MAX_PARALLAX_PX = 1.2, 100.0
"""Matches this close to the epipolar lines of a pair and to its plane are right. Farther from the plane, most lie on
the lines by chance: one in eight of all that do, over fields, where three quarters of the matches are false."""
CHECKED = 4
"""Each match of this many becomes a check: it takes no part in the layout, and shows how far that is off."""
SEARCH_PX = 32.0
"""Radius of the search around a predicted place: three times what weak links leave a layout off."""
SURE_WEIGHT = 0.7
"""Weight that a match found by prediction needs to be a check: lighter ones are wrong three times as often, and so near
the prediction, epipolar lines do not tell."""
WEAK_TIES = 40
"""A link with fewer ties is weak; it matters if no other joins the two sides."""
FIRST_LOOK_SAMPLES = 1000
"""A third of the samples of a single pair: most candidates overlap well or not at all."""

_POINTS = tuple(f"{side}_{kind}" for kind in ("points", "checks", "moving", "relief") for side in ("left", "right"))
Candidate = tuple[int, int]
"""Indices of two views, the smaller first."""


@dataclass(frozen=True, eq=False)
class Link:
    """Two views that were matched, whether they show the same ground or not."""

    left: int
    right: int
    """Indices of the views, left < right."""
    left_points: Points
    right_points: Points
    """(N, 2): the ties, matches within 3 working px of the pair's homography; none where the views are not linked."""
    inliers: int
    """Matches within 2 px of the best homography."""
    near: int
    """Matches within 12 px of it."""
    left_checks: Points = field(default_factory=lambda: np.zeros((0, 2)))
    right_checks: Points = field(default_factory=lambda: np.zeros((0, 2)))
    """(M, 2): matches that are no ties, although as good: they are for `skymosaic.flight.layout.accuracy`. The epipolar
    geometry of the pair explains them, so they lie on the plane or on relief."""
    left_moving: Points = field(default_factory=lambda: np.zeros((0, 2)))
    right_moving: Points = field(default_factory=lambda: np.zeros((0, 2)))
    """(K, 2): matches that agree, but not on the ground: they move with the camera, and were left out."""
    left_relief: Points = field(default_factory=lambda: np.zeros((0, 2)))
    right_relief: Points = field(default_factory=lambda: np.zeros((0, 2)))
    """(L, 2): neither ties nor checks, but explained by the epipolar geometry, so that they lie on relief."""

    @property
    def ties(self) -> int:
        """Number of ties."""
        return len(self.left_points)

    @property
    def holds(self) -> bool:
        """Whether the views are linked: a single tie does not say how one lies on the other."""
        return self.ties > 1

    @property
    def moves_with_camera(self) -> bool:
        """Whether matches that move with the camera were left out."""
        return len(self.left_moving) > 0

    def pack(self) -> Arrays:
        """Turn the link into arrays for a file, without the indices, which are valid for one list of views only."""
        counts = np.array([self.inliers, self.near])
        return {name: getattr(self, name) for name in _POINTS} | {"counts": counts}

    @classmethod
    def unpack(cls, arrays: Arrays, left: int, right: int) -> Link:
        """Read the link that `pack` turned into arrays."""
        inliers, near = arrays["counts"].tolist()
        points = {name: arrays[name].astype(np.float64) for name in _POINTS}
        return cls(left, right, inliers=inliers, near=near, **points)

    def move(self, moves: Mapping[int, Callable[[Points], Points]]) -> Link:
        """The same link with the points of some views moved."""
        moved: dict[str, Any] = {}
        for view, names in ((self.left, _POINTS[::2]), (self.right, _POINTS[1::2])):
            if view in moves:
                points = [getattr(self, name) for name in names]
                ends = np.cumsum([len(each) for each in points])[:-1]
                # At once, because each call has a fixed cost.
                moved |= dict(zip(names, np.split(moves[view](np.concatenate(points)), ends), strict=True))
        return replace(self, **moved)


def valid_links(links: Mapping[Candidate, Link]) -> list[Link]:
    """The links that hold."""
    return [link for link in links.values() if link.holds]


_Fit = tuple[Points, Points, Array, Estimate]
"""Matches, their weights, and what was estimated from them."""


def link_views(
    pair: Candidate,
    left: Records,
    right: Records,
    *,
    config: Config,
    seed: int,
    sights: tuple[Sight, Sight],
    max_samples: int = FIRST_LOOK_SAMPLES,
    predicted: Matrix | None = None,
    matches: Records | None = None,
) -> Link:
    """Match the features of two views and fit a homography.

    Parameters
    ----------
    pair, left, right
        Indices of the views, and their feature records.
    config : Config
        By which the features were computed.
    seed : int
        Seed of the robust estimator. The same for every pair, so that no link depends on which others are tried.
    sights : tuple of Sight
        The pictures of both, which tell whether it is the ground that agrees.
    max_samples : int
        Samples of the robust estimator, at most.
    predicted : ndarray of float64, shape (3, 3), or None
        Left to right working px as a layout has them: features match only within 32 px of their predicted place.
    matches : structured array or None
        Match records that somebody else has found; the features play no part then.
    """
    if matches is not None:
        predicted = None
    elif predicted is None:
        matches = match(left, right, config.front_end.pattern, config.matcher)
    else:
        matches = match_nearby(left, right, predicted, config)
    accepted = matches[matches["verdict"] == 1]
    points = match_points(accepted)
    rng = np.random.default_rng(seed)

    def search(left_out: LeftOut) -> tuple[_Fit, Matrix | None, tuple[Points, Points]]:
        apart = left_out.are_apart(*points)
        left_points, right_points, weight = points[0][apart], points[1][apart], accepted["weight"][apart].astype(float)
        # One search: a link that it misses is made up for by the others, which the layout predicts.
        found = estimate_homography(left_points, right_points, weight, rng=rng, max_samples=max_samples, restarts=1)
        inliers = left_points[found.inliers], right_points[found.inliers]
        return (left_points, right_points, weight, found), found.homography, inliers

    (left_points, right_points, weight, estimate), agreement, left_out = find_ground(search, lambda _fit: sights)
    inliers, nothing = int(np.count_nonzero(estimate.inliers)), np.zeros((0, 2))
    moving: dict[str, Any] = {}
    if left_out.rejected:
        _, moving["left_moving"], moving["right_moving"] = left_out.rejected[0]
    if estimate.homography is None or not (agreement is None or agreement.suffices):
        return Link(*pair, nothing, nothing, inliers, near=0, **moving)
    checks = np.zeros(len(left_points), np.bool_)
    checks[::CHECKED] = True
    link = tie_views(pair, left_points[~checks], right_points[~checks], estimate.homography, inliers)
    sound = are_right(left_points, right_points, estimate.homography)
    if predicted is not None:
        sound &= weight > SURE_WEIGHT * WEIGHT.one
    relief = sound & ~checks & (transfer_error(estimate.homography, left_points, right_points) > TIE_PX)
    checks &= sound
    return replace(
        link,
        left_checks=left_points[checks],
        right_checks=right_points[checks],
        left_relief=left_points[relief],
        right_relief=right_points[relief],
        **moving,
    )


def match_nearby(left: Records, right: Records, predicted: Matrix, config: Config) -> Records:
    """Match features that lie near each other by a predicted homography.

    On crops, roofs or water many features look alike: their second best matches are about as good as the best, so the
    rules reject both. Near the predicted place few are left to choose from. Arguments are as of `link_views`; the
    indices of the match records count only features with a partner in reach.
    """
    moved, right_points = apply(predicted, feature_points(left)), feature_points(right)
    has_right = KDTree(right_points).query(moved)[0] <= SEARCH_PX
    has_left = KDTree(moved).query(right_points)[0] <= SEARCH_PX
    left, right = left[has_right], right[has_left]
    pattern = config.front_end.pattern
    distance = hamming.distances(left["descriptor"], right["descriptor"])
    distance[cdist(moved[has_right], right_points[has_left]) > SEARCH_PX] = pattern.bits
    return match(left, right, pattern, config.matcher, distance)


def are_right(left_points: Points, right_points: Points, homography: Matrix) -> NDArray[np.bool_]:
    """Find the matches (N, 2) that are right by the epipolar geometry of a pair, on the plane or on relief, (N,)."""
    error_px = transfer_error(homography, left_points, right_points)
    near = error_px <= MAX_PARALLAX_PX
    try:
        # OpenCV draws the same samples each time.
        points = left_points[near], right_points[near]
        _, kept = cv2.findFundamentalMat(*points, cv2.USAC_MAGSAC, EPIPOLAR_PX, 0.999, 1000)
    # Instead of an answer, where no sample has one.
    except cv2.error:
        kept = None
    if kept is None:
        return np.asarray(error_px <= TIE_PX)
    near[near] = kept.ravel() > 0
    return np.asarray(near)


def tie_views(pair: Candidate, left_points: Points, right_points: Points, homography: Matrix, inliers: int) -> Link:
    """Link two views by their matches (N, 2) that a known homography explains, all in working px.

    ``inliers`` is how many lie within 2 px of it.
    """
    error_px = transfer_error(homography, left_points, right_points)
    is_tie = error_px <= TIE_PX
    near = int(np.count_nonzero(error_px <= RELIEF_PX))
    return Link(*pair, left_points[is_tie], right_points[is_tie], inliers, near)
