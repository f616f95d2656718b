"""Robust homography from weighted matches: PROSAC with local optimisation.

Sampling follows Chum and Matas (Matching with PROSAC, CVPR 2005): matches are ordered by weight, and samples are drawn
from a growing set of the best. Samples are solved and scored in batches. The best sample of a batch is improved by the
DLT over its shrinking inlier band (Chum, Matas and Kittler, Locally optimized RANSAC, 2003), the final homography by
reweighted Gauss-Newton.

Where the ground is not flat, several planes explain part of the matches, and a search that stops at the first good one
depends on the seed. So the search is restarted, and the homography with the highest score wins.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from golden_model.arrays import Array, Mask, Matrix
from skymosaic.geometry.homography import (
    DegenerateError,
    apply,
    check_pairs,
    design_matrix,
    homogeneous,
    normalisation,
    rescale,
)
from skymosaic.geometry.refinement import refine_robustly

MAX_SAMPLES = 3000
TOLERANCE_PX = 3.0
"""tau of the score: a match with an error below sqrt(2) tau supports a homography."""
LOCAL_BANDS = (2.0, 1.5, 1.0)
"""Inlier bands of the local optimisation, in tau."""
MIN_GAIN = 0.01
"""The local optimisation continues while a round raises the score by at least this share."""
INLIER_PX = 2.0
"""Maximum error of an inlier, in pixels of the working image; every stage of registration uses it."""
MIN_INLIERS = 12
"""A homography with fewer inliers is not accepted."""
CONFIDENCE = 0.9999
"""Sampling stops once a sample without wrong matches has been drawn with this probability."""
RESTARTS = 3
"""Independent searches; the homography with the highest score wins."""
CLEAR_SHARE = 0.5
"""A search that gains more than this share of all weights ends the restarts: no other plane can gain as much."""
BEST_MATCHES = 48
"""Samples of all matches seldom hit a few right ones. Samples of so many of the best do, if nine of these are right."""
BATCH = 128
"""Samples that are solved and scored together, because NumPy is fast on arrays only."""
EIGENVALUE_TOLERANCE = 1e-13
"""Normal equations are degenerate if their second smallest eigenvalue is below this share of the largest."""
TRIANGLES = np.array([(1, 2, 3), (2, 0, 3), (0, 1, 3), (0, 1, 2)]).T
"""The triangles among a sample's four points, one a column. The first three leave out point 0, 1 and 2; the ratios of
their areas to the last give the fourth point as a combination of the first three."""
_Found = tuple[Array | None, float, int]  # the homography with the highest score, its score, the samples drawn


@dataclass(frozen=True)
class Estimate:
    """Result of `estimate_homography`."""

    homography: Array | None
    """(3, 3): maps left to right, H[2, 2] = 1; None if not accepted."""
    inliers: Mask
    """(N,): matches within 2 px of the best homography, whether it is accepted or not."""
    samples: int
    """Minimal samples drawn."""


class _Matches:
    """Point pairs in order of falling weight, and the rows of the DLT for all of them in one normalisation."""

    def __init__(self, left: ArrayLike, right: ArrayLike, weight: ArrayLike) -> None:
        x, y = check_pairs(left, right, minimum=0)
        w = np.asarray(weight, dtype=np.float64)
        if w.shape != (len(x),) or not (np.isfinite(w) & (w >= 0)).all():
            raise ValueError(f"weights have the shape {w.shape}; need ({len(x)},), finite and not negative")
        self.order = np.argsort(-w, kind="stable")
        self.left, self.right, self.weight = x[self.order], y[self.order], w[self.order]
        self._lifted = homogeneous(self.left).T
        # Without two different points there is nothing to normalise and no sample to fit.
        self._fits = all(len(points) and np.ptp(points, axis=0).any() for points in (x, y))
        if self._fits:
            self._to_left, self._to_right = normalisation(self.left), normalisation(self.right)
            self._rows = design_matrix(apply(self._to_left, self.left), apply(self._to_right, self.right))

    def squared_error(self, H: Array) -> Array:
        """Squared transfer error (N,) in the right image, px²."""
        return np.asarray(((apply(H, self.left) - self.right) ** 2).sum(axis=-1))

    def score(self, squared_error: Array) -> Array:
        """Sum of w max(0, 1 - e²/2tau²) over the last axis; 0 for points that map to infinity."""
        return np.asarray(np.fmax(0, 1 - squared_error / (2 * TOLERANCE_PX**2)) @ self.weight)

    def score_all(self, homographies: Array) -> Array:
        """`score` (M,) of homographies (M, 3, 3)."""
        x, y, w = (homographies.reshape(-1, 3) @ self._lifted).reshape(len(homographies), 3, -1).transpose(1, 0, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            squared_error = (x / w - self.right[:, 0]) ** 2 + (y / w - self.right[:, 1]) ** 2
        return self.score(squared_error)

    def fit(self, chosen: Mask) -> Matrix:
        """Fit the chosen matches by the weighted DLT, from its normal equations.

        The 9x9 matrix loses half of the digits that `skymosaic.geometry.homography.dlt` keeps. That does not matter
        for a step of a search, and it takes a fraction of the time.
        """
        if not self._fits or np.count_nonzero(chosen) < 4:
            raise DegenerateError("fewer than 4 matches")
        rows = self._rows.reshape(-1, 2, 9)[chosen]
        weighted = rows * self.weight[chosen, None, None]
        values, vectors = np.linalg.eigh(weighted.reshape(-1, 9).T @ rows.reshape(-1, 9))
        if values[1] <= EIGENVALUE_TOLERANCE * values[-1]:
            raise DegenerateError("the matches do not determine a homography")
        return rescale(np.linalg.inv(self._to_right) @ vectors[:, 0].reshape(3, 3) @ self._to_left)

    def polish(self, H: Matrix | None, samples: int) -> Estimate:
        """Refine the best homography over all matches; its inliers are in the order in which these were given."""
        inliers = np.zeros(len(self.left), dtype=bool)
        if H is None:
            return Estimate(None, inliers, samples)
        finite = np.isfinite(self.squared_error(H))
        try:
            best = refine_robustly(H, self.left[finite], self.right[finite])
        except DegenerateError:
            return Estimate(None, inliers, samples)
        inliers[self.order] = self.squared_error(best) <= INLIER_PX**2
        return Estimate(best if inliers.sum() >= MIN_INLIERS else None, inliers, samples)


def estimate_homography(
    left: ArrayLike,
    right: ArrayLike,
    weight: ArrayLike,
    *,
    rng: np.random.Generator,
    max_samples: int = MAX_SAMPLES,
    restarts: int = RESTARTS,
    starts: Sequence[Matrix] = (),
) -> Estimate:
    """Fit a homography to matches of which many may be wrong.

    Parameters
    ----------
    left, right : (N, 2) array_like
        Matched points, px; any N.
    weight : (N,) array_like
        Non-negative confidence of each match, in any unit; orders the sampling and weighs the score.
    rng : numpy.random.Generator
        Source of the samples; the same state gives the same result.
    max_samples : int
        Samples per search; it ends earlier once a better homography is improbable.
    restarts : int
        Independent searches at most; the homography with the highest score wins. With 0, only ``starts`` compete.
    starts : sequence of (3, 3) ndarray
        Homographies known from elsewhere, which compete after local optimisation.

    Returns
    -------
    Estimate
        Not accepted where fewer than 12 matches agree within 2 px.

    Raises
    ------
    ValueError
        For wrong shapes, values that are not finite, or negative weights.
    """
    matches = _Matches(left, right, weight)
    results: list[_Found] = []
    sampled = len(matches.left)
    for _ in range(restarts):
        results.append(_search(matches, rng, _subset_sizes(sampled, max_samples)))
        found, score, _ = results[-1]
        is_vain = found is None or np.count_nonzero(matches.squared_error(found) <= INLIER_PX**2) < MIN_INLIERS
        if score > CLEAR_SHARE * matches.weight.sum() or (is_vain and len(matches.left) <= BEST_MATCHES):
            break
        # Restarts choose between planes. Where there is none yet, the best matches may have one.
        sampled = BEST_MATCHES if is_vain else sampled
    results += [(*_optimise_locally(start, matches), 0) for start in starts]
    best, _, _ = max(results, key=lambda result: result[1], default=(None, 0.0, 0))
    return matches.polish(best, sum(samples for _, _, samples in results))


def _search(matches: _Matches, rng: np.random.Generator, subset_sizes: NDArray[np.int64]) -> _Found:
    """Search once, by a sample from each of the subsets."""
    best, best_score, best_sample_score = None, 0.0, 0.0
    supports = np.zeros(len(matches.left), dtype=bool)
    drawn, needed = 0, float(len(subset_sizes))
    while drawn < min(needed, len(subset_sizes)):
        batch = subset_sizes[drawn : drawn + BATCH]
        drawn += len(batch)
        sample, sample_score = _best_of(_minimal_homographies(matches, _draw(batch, rng)), matches)
        # Compared with the best sample, which local optimisation has not improved: few would beat the best homography.
        if sample is not None and sample_score > best_sample_score:
            best_sample_score = sample_score
            improved, score = _optimise_locally(sample, matches)
            if score > best_score:
                best, best_score = improved, score
                supports = matches.squared_error(best) < 2 * TOLERANCE_PX**2
        # All samples so far are from the best matches, among which more are right than among all.
        needed = _samples_needed(supports[: batch[-1]])
    return best, best_score, drawn


def _subset_sizes(count: int, max_samples: int) -> NDArray[np.int64]:
    """Size of the set of best matches from which each PROSAC sample is drawn, (samples,).

    Among ``max_samples`` uniform samples of all matches, a certain number would have the n-th match as their worst. The
    n best matches serve that many samples, but at least one.
    """
    if count < 4:
        return np.zeros(0, dtype=np.int64)
    size = np.arange(4, count + 1)
    # Of all samples, the share that is drawn from the best n matches alone: C(n, 4) / C(count, 4).
    share = size * (size - 1.0) * (size - 2) * (size - 3) / (count * (count - 1.0) * (count - 2) * (count - 3))
    samples_of_size = np.ceil(np.diff(max_samples * share, prepend=0)).astype(np.int64)
    return np.repeat(size, samples_of_size)[:max_samples]


def _draw(subset_sizes: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
    """One sample (B, 4) from each subset: its last match and three distinct others (Floyd's algorithm)."""
    chosen = np.repeat(subset_sizes[:, None] - 1, 4, axis=1)
    for column in range(3):
        last = subset_sizes - 4 + column
        pick = rng.integers(0, last + 1)
        taken = (chosen[:, :column] == pick[:, None]).any(axis=1)
        chosen[:, column] = np.where(taken, last, pick)
    return chosen


def _minimal_homographies(matches: _Matches, samples: NDArray[np.int64]) -> Array:
    """Homographies (M, 3, 3) of the samples (B, 4) that preserve orientation and are not degenerate.

    In homogeneous coordinates the fourth point is p3 = sum_i a_i p_i, i = 0..2, where a_i is a ratio of triangle
    areas. With b_i the same ratio for the right points, H = sum_i (b_i / a_i) q_i (p_j x p_k)'. The signs of the areas
    are the orientation test: a view from the same side turns no triangle over. All four third coordinates are positive.
    """
    left, right = (points.T[:, samples.T] for points in (matches.left, matches.right))
    left_areas, right_areas = _areas(left), _areas(right)
    # Twice the area of a triangle with base and height tau; the orientation of a smaller one is decided by noise.
    large = np.minimum(np.abs(left_areas), np.abs(right_areas)).min(axis=0) > TOLERANCE_PX**2
    usable = large & (left_areas * right_areas > 0).all(axis=0)
    left, right = left[:, :3, usable], homogeneous(right[:, :3, usable].T)
    ratio = right_areas[:3, usable] / left_areas[:3, usable] * np.sign(left_areas[3, usable])
    # The cross product of the next two points, whose third coordinate is 1.
    (x, y), (next_x, next_y) = left[:, [1, 2, 0]], left[:, [2, 0, 1]]
    crossed = np.stack([y - next_y, next_x - x, x * next_y - y * next_x])
    return np.asarray((right * ratio.T[..., None]).transpose(0, 2, 1) @ crossed.T)


def _areas(points: Array) -> Array:
    """Twice the signed areas (4, B) of the `TRIANGLES` among points (2, 4, B)."""
    corner, *others = (points[:, which] for which in TRIANGLES)
    first, second = (other - corner for other in others)
    return np.asarray(first[0] * second[1] - first[1] * second[0])


def _best_of(homographies: Array, matches: _Matches) -> tuple[Array | None, float]:
    if len(homographies) == 0:
        return None, 0.0
    values = matches.score_all(homographies)
    best = int(np.argmax(values))
    return homographies[best], float(values[best])


def _optimise_locally(H: Array, matches: _Matches) -> tuple[Array, float]:
    """Refit by DLT to the matches within each band in turn, repeat while the score rises; the best and its score."""
    score, gain = float(matches.score(matches.squared_error(H))), 1.0
    while gain > MIN_GAIN:
        start = score
        refit = H
        for band in LOCAL_BANDS:
            near = matches.squared_error(refit) <= (band * TOLERANCE_PX) ** 2
            try:
                refit = matches.fit(near)
            except DegenerateError:
                break
            refit_score = float(matches.score(matches.squared_error(refit)))
            if refit_score > score:
                H, score = refit, refit_score
        gain = score / start - 1 if start else 0.0
    return H, score


def _samples_needed(supports: Mask) -> float:
    """Samples needed for one without outliers, with probability `CONFIDENCE`, of matches that may support the best."""
    # With no inlier or no outlier at all, a logarithm below would be of 0 or 1.
    good_sample = np.clip(np.mean(supports) ** 4, 1e-9, 1 - 1e-9)
    return float(np.log(1 - CONFIDENCE) / np.log1p(-good_sample))
