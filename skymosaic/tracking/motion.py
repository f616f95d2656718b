"""Which of the matches around an object move with it, and which with its surroundings."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from golden_model.arrays import Array, Mask
from skymosaic.geometry.homography import apply, transfer_error
from skymosaic.geometry.model_selection import TOLERANCE_PX, Fit, fit_similarity

MIN_OTHERS = 8
"""Matches that have to agree on another motion than that of the surroundings before it is known that there is one."""
MAX_SURROUNDINGS = 48
"""Matches of the surroundings that determine their motion; more take longer."""
Find = Callable[..., Fit | None]
"""How a motion is fitted: as `fit` does, or `fit_similarity`."""


class Matches(NamedTuple):
    """Matches of two views of an object.

    ``left`` and ``right`` (N, 2) are positions in the enlarged template and, at the same scale, in the frame;
    ``weight`` (N,) is 0 for matches that are not trusted, and ``outside`` (N,) are those of the surroundings.
    """

    left: Array
    right: Array
    weight: Array
    outside: Mask


def fit_surroundings(matches: Matches) -> Fit | None:
    """How the surroundings move; None where fewer than 8 of their matches agree."""
    outside = np.flatnonzero(matches.outside)
    some = outside[:: 1 + len(outside) // MAX_SURROUNDINGS]
    return fit_similarity(matches.left[some], matches.right[some], np.ones(len(some)), fewest=MIN_OTHERS)


def fit_object(
    matches: Matches, still: Array, around: Array | None, expected: Array | None, find: Find, *, fewest: int
) -> tuple[Fit | None, Mask]:
    """Fit the motion of an object without the matches of other motions.

    A rectangle around an object has some ground in it, and text may lie over it. Until the object is known to move
    otherwise, such matches are left out only where at least 8 others agree on a motion that most of them do not have.
    Their own motion is that of the object only if most matches agree.

    ``still`` (3, 3) is the motion of what stands still in the frame, left to right, ``around`` that of the
    surroundings, and ``expected`` that of an object that is known to move otherwise. Returns also which trusted matches
    were left out, (N,).
    """
    left, right, weight, _ = matches
    trusted = weight > 0
    if not trusted.any():
        return None, trusted
    foreign = [still] if around is None else [still, around]
    if expected is not None:
        # Where both motions lead to the same place, they cannot be told apart.
        ahead = apply(expected, left)
        foreign = [each for each in foreign if np.median(transfer_error(each, left, ahead)) > 2 * TOLERANCE_PX]
    left_out = trusted & np.any([transfer_error(each, left, right) <= TOLERANCE_PX for each in foreign], axis=0)
    others = trusted & ~left_out
    if left_out.any():
        own = left[others], right[others], weight[others]
        if expected is not None:
            return find(*own, fewest=fewest), left_out
        # Most often there is no other motion, as a similarity tells sooner.
        enough = max(fewest, MIN_OTHERS)
        if fit_similarity(*own, fewest=enough):
            best = find(*own, fewest=enough)
            if best and _differ(best.matrix, left[left_out], right[left_out]):
                return best, left_out
    own = left[trusted], right[trusted], weight[trusted]
    best = find(*own, fewest=fewest)
    if best and 2 * best.inliers < len(own[0]):
        there = apply(best.matrix, own[0])
        if not all(_differ(each, own[0], there) for each in foreign):
            best = None
    return best, np.zeros_like(trusted)


def _differ(motion: Array, left: Array, right: Array) -> bool:
    """Whether most matches do not have a motion."""
    return bool(np.median(transfer_error(motion, left, right)) > TOLERANCE_PX)
