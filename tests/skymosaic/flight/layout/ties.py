"""Ties between the pictures of a flight, from its exact poses, among them false ones as repeated textures give them."""

from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Matrix, Points
from sim.scene.camera import project
from sim.scene.flight import Flight

NOISE_PX = 0.3
MIN_TIES, MAX_TIES = 30, 200
TRIED_POINTS = 1000
MIN_OVERLAP = 0.25
DIRECTIONS = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])


@dataclass(frozen=True, eq=False)
class TiedPair:
    """Two pictures with common points, (N, 2) px each; ``true`` if they are the same points of the ground."""

    left: int
    right: int
    left_points: Points
    right_points: Points
    true: bool


def tie_pictures(flight: Flight, seed: int, false_share: float, period_px: float) -> list[TiedPair]:
    """Ties of all pairs that overlap, and of false pairs, in rising order of the pairs.

    Parameters
    ----------
    flight : Flight
    seed : int
    false_share : float
        False pairs for each that overlaps, 0..1. Half of them replace its ties, half join pictures far apart.
    period_px : float
        How far the ground of a false tie lies from the true one, in ground px: as if a façade, rows of roofs or an
        orchard repeated after it, in one of four directions. Pictures far apart look alike on top of that.
    """
    rng = np.random.default_rng(seed)
    count, homographies = len(flight.poses), flight.homographies
    pairs = [(i, j) for i in range(count) for j in range(i + 1, count)]
    overlapping = [pair for pair in pairs if flight.overlap_between(*pair) > MIN_OVERLAP]
    apart = [pair for pair in pairs if flight.overlap_between(*pair) == 0]
    false = {
        among[row]
        for among in (overlapping, apart)
        for row in rng.choice(len(among), round(false_share * len(overlapping) / 2), replace=False).tolist()
    }
    tied = []
    for left, right in sorted({*overlapping, *false}):
        shift = np.zeros(2)
        if (left, right) in false:
            shift = period_px * DIRECTIONS[rng.integers(len(DIRECTIONS))]
            if flight.overlap_between(left, right) == 0:
                one, other = (flight.poses[side] for side in (left, right))
                shift = shift + np.array([other.x_px - one.x_px, other.y_px - one.y_px])
        ties = _ties(flight, homographies[left], homographies[right], shift, rng)
        if len(ties[0]) >= MIN_TIES:
            tied.append(TiedPair(left, right, *ties, true=(left, right) not in false))
    return tied


def _ties(
    flight: Flight, to_left: Matrix, to_right: Matrix, shift: Points, rng: np.random.Generator
) -> tuple[Points, Points]:
    """Points of the left picture, and where the right one shows the ground ``shift`` beside them."""
    size = np.array([flight.camera.width_px, flight.camera.height_px])
    left_points = rng.uniform(0, size - 1, (TRIED_POINTS, 2))
    right_points = project(to_right, project(np.linalg.inv(to_left).astype(np.float64), left_points) + shift)
    common = np.flatnonzero(((right_points >= 0) & (right_points < size)).all(axis=1))
    common = common[: rng.integers(MIN_TIES, MAX_TIES)]
    left_noise, right_noise = rng.normal(0, NOISE_PX, (2, len(common), 2))
    return left_points[common] + left_noise, right_points[common] + right_noise
