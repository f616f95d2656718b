"""Quality of features, matches and homographies, measured against the truth (thesis, equations IV-2 to IV-7)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from golden_model.arrays import Array, Mask
from skymosaic.geometry.homography import apply, grid_over, transfer_error
from skymosaic.geometry.horizon import ahead

GRID_POINTS = 20
MISSING_ERROR_PX = 1000.0
"""Grid error of a missing homography."""


@dataclass(frozen=True)
class Confusion:
    """Numbers of matches that were kept or rejected, correctly or wrongly."""

    true_positives: int
    false_positives: int
    true_negatives: int
    false_negatives: int

    @property
    def recall(self) -> float:
        """Correct matches kept / all correct matches (equation IV-6); 0 if there are none."""
        return _ratio(self.true_positives, self.true_positives + self.false_negatives)

    @property
    def precision(self) -> float:
        """Correct matches kept / all matches kept, which is 1 minus equation IV-7; 0 if none was kept."""
        return _ratio(self.true_positives, self.true_positives + self.false_positives)


def confusion(kept: ArrayLike, correct: ArrayLike) -> Confusion:
    """Count the four combinations of ``kept`` and ``correct`` matches, both (N,) bool."""
    positive, true = np.asarray(kept, dtype=bool), np.asarray(correct, dtype=bool)
    return Confusion(
        true_positives=int(np.count_nonzero(positive & true)),
        false_positives=int(np.count_nonzero(positive & ~true)),
        true_negatives=int(np.count_nonzero(~positive & ~true)),
        false_negatives=int(np.count_nonzero(~positive & true)),
    )


def correct_matches(left: ArrayLike, right: ArrayLike, truth: Array, *, tolerance_px: float = 3.0) -> Mask:
    """Whether each match, ``left`` (N, 2) to ``right`` (N, 2), agrees with the true homography, (N,) bool.

    A match agrees if its transfer error is at most ``tolerance_px``.
    """
    return np.asarray(transfer_error(truth, left, right) <= tolerance_px)


def rmse(H: Array, left: ArrayLike, right: ArrayLike) -> float:
    """Root mean square distance of Hx from x', px (equations IV-3 to IV-5), over at least one match."""
    return float(np.sqrt(np.mean(transfer_error(H, left, right) ** 2)))


def repeatability(
    left: ArrayLike, right: ArrayLike, truth: Array, right_size: tuple[int, int], *, tolerance_px: float = 1.5
) -> float:
    """Share of the left features in the overlap that were also detected in the right image (equation IV-2).

    Two features, (N, 2) and (M, 2), correspond if each is the other's nearest neighbour and their distance is at most
    ``tolerance_px`` (1.5 px: Schmid, Mohr and Bauckhage 2000). The share is of the left features that the truth maps
    into the right image; 0 if it maps none.
    """
    mapped, detected = apply(truth, left), np.asarray(right, dtype=np.float64)
    query = mapped[_inside(mapped, right_size)]
    if len(query) == 0 or len(detected) == 0:
        return 0.0
    distance, nearest = KDTree(detected).query(query)
    _, nearest_query = KDTree(query).query(detected)
    # Mutual, so that each feature counts once where features are dense.
    mutual = nearest_query[nearest] == np.arange(len(query))
    return _ratio(int(np.count_nonzero(mutual & (distance <= tolerance_px))), len(query))


def grid_error(estimated: Array | None, truth: Array, left_size: tuple[int, int], right_size: tuple[int, int]) -> float:
    """Mean distance between two homographies over the overlap, px.

    The mean is over those of 20x20 points spread over the left image that the truth maps into the right one. It is
    `MISSING_ERROR_PX` for None, and for a homography that maps one of them to infinity.

    Raises
    ------
    ValueError
        If the truth maps none of them into the right image.
    """
    points = grid_over(left_size, GRID_POINTS)
    expected = apply(truth, points)
    inside = _inside(expected, right_size) & (ahead(truth, points) > 0)
    if not inside.any():
        raise ValueError("the images do not overlap under the true homography")
    if estimated is None:
        return MISSING_ERROR_PX
    error = float(transfer_error(estimated, points[inside], expected[inside]).mean())
    return error if np.isfinite(error) else MISSING_ERROR_PX


def _inside(points: Array, size: tuple[int, int]) -> Mask:
    return np.asarray(((points >= 0) & (points <= np.array(size) - 1)).all(axis=-1))


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else 0.0
