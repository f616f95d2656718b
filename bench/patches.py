"""How much of an overlap a homography lays on itself, by patches of the pictures: a yardstick for pairs with relief.

The truth of a real pair is a homography as well, one of several planes, and favours the method that gave it. So small
patches are looked for around where the answer puts them and around where that truth does, there and back; what is
found, from either side, is where the ground is. The patches of two methods are nearly but not quite the same ones.
"""

from typing import NamedTuple

import cv2
import numpy as np

from golden_model.arrays import Array, Mask, Matrix, Pixels, Points
from skymosaic.geometry.homography import apply

PATCH_PX, SEARCH_PX, STEP_PX = 41, 12, 32
"""Side of a patch, how far from a guess it is looked for, and from one patch to the next."""
MIN_CORRELATION = 0.6
MIN_PATCHES = 8
BACK_PX = 1.5
"""How far from where it began a patch may arrive that is looked for there and back."""
NEAR_PX = 2.0


class _Found(NamedTuple):
    """Where patches lie in the right image (N, 2), and how well they correlate there (N,), 0 where none is found."""

    right: Points
    correlation: Array


def confirmed_share(left: Pixels, right: Pixels, answer: Matrix | None, truth: Matrix) -> float | None:
    """Share of the patches, of those that are found in both images, that an answer puts within `NEAR_PX`.

    None where fewer than `MIN_PATCHES` are found. Of a field in rows, a few are found a row off.

    Parameters
    ----------
    left, right : (H, W) uint8
    answer, truth : (3, 3) ndarray
        Left to right, px; the answer of a pair that is refused is None, which puts nothing anywhere.
    """
    centres = _patch_centres(left.shape)
    guesses = [truth] if answer is None else [answer, truth]
    found = [_find_patches(left, right, guess, centres) for guess in guesses]
    correlations = np.stack([each.correlation for each in found])
    known: Mask = correlations.max(axis=0) > 0
    if np.count_nonzero(known) < MIN_PATCHES:
        return None
    if answer is None:
        return 0.0
    better = np.stack([each.right for each in found])[correlations.argmax(axis=0), np.arange(len(centres))]
    return float(np.mean(np.linalg.norm(apply(answer, centres) - better, axis=1)[known] <= NEAR_PX))


def _patch_centres(shape: tuple[int, ...]) -> Points:
    """A grid over the left image (N, 2), as far from its edges as a search from there and back may reach."""
    edge_px = PATCH_PX // 2 + 2 * SEARCH_PX
    y, x = np.mgrid[edge_px : shape[0] - edge_px : STEP_PX, edge_px : shape[1] - edge_px : STEP_PX]
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)


def _find_patches(left: Pixels, right: Pixels, guess: Matrix, centres: Points) -> _Found:
    """Look for the patches of the left image around where a guess puts them in the right one, and back."""
    size, flags = left.shape[::-1], cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = np.asarray(cv2.warpPerspective(right, guess, size, flags=flags), np.uint8)
    shown = np.asarray(cv2.warpPerspective(np.full_like(right, 255), guess, size, flags=flags), np.uint8)
    places, correlation = centres.copy(), np.zeros(len(centres))
    for number, centre in enumerate(centres.astype(int)):
        if np.any(_cut(shown, centre, SEARCH_PX) < 255):
            continue
        there, alike = _find(_cut(left, centre), _cut(warped, centre, SEARCH_PX))
        back, _ = _find(_cut(warped, centre + there), _cut(left, centre + there, SEARCH_PX))
        if alike >= MIN_CORRELATION and np.linalg.norm(there + back) <= BACK_PX:
            places[number], correlation[number] = centre + there, alike
    return _Found(apply(guess, places), correlation)


def _find(patch: Pixels, window: Pixels) -> tuple[Array, float]:
    """How far from the middle of a window a patch fits best, (2,), and its correlation there."""
    alike = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
    _, best, _, (x, y) = cv2.minMaxLoc(alike)
    return np.array([x, y]) - SEARCH_PX, float(best)


def _cut(image: Pixels, centre: Array, around_px: int = 0) -> Pixels:
    """The patch around a place, and so much more on each side."""
    reach_px = PATCH_PX // 2 + around_px
    x, y = (slice(int(at) - reach_px, int(at) + reach_px + 1) for at in centre)
    return image[y, x]
