"""Images of even contrast, without the pattern that a sensor adds to all of them."""

from collections.abc import Sequence

import cv2
import numpy as np

from golden_model.arrays import Float32, Mask, Pixels
from golden_model.pixel.gray import to_gray

DETAIL_SIGMA_PX, EVEN_SPREAD = 12.0, 45.0
"""What is coarser is light, and the standard deviation of gray levels that is left, see `even_contrast`."""
PATTERN_SIGMA_PX = 3.0
"""What is coarser is ground. Of two images, the mean of all detail would leave each as the negative of the other."""
ENOUGH = 100
"""More images make no difference."""
SHARED, LOCALLY_SHARED, SHARED_SIDE_PX = 0.1, 0.5, 21
"""Correlation of two images' fine detail in squares of this side. Under a pattern, nine tenths of them have more than
the first; behind a display or a border, a tenth has less than zero. More than the second is no chance: that is four
standard deviations of what different ground has."""


def find_pattern(images: Sequence[Pixels]) -> Float32:
    """What images of one camera have in common, each at the same pixels: the median of their fine detail, (H, W).

    A display that stands still is part of it, a sensor's columns and bright pixels are. Two images are enough to find
    it, although half of each one's own detail is then taken for it, too.
    """
    return np.asarray(np.median([_fine_detail(image) for image in images[:: 1 + len(images) // ENOUGH]], axis=0))


def share_pattern(left: Pixels, right: Pixels) -> bool:
    """Whether the fine detail of two images is alike at the same pixels nearly everywhere, which no display is."""
    if left.shape[:2] != right.shape[:2]:
        return False
    # With less of a quarter, nine tenths of the whole are impossible: most different photographs end there.
    part, whole = slice(len(left) // 4), slice(None)
    shares = (np.mean(_likeness(left[rows], right[rows]) > SHARED) for rows in (part, whole))
    return bool(next(shares) > 0.6 and next(shares) > 0.9)


def find_shared(left: Pixels, right: Pixels) -> Mask:
    """Where two images of one size are alike at the same pixels, as in the text of a display, (H, W)."""
    alike = (_likeness(left, right) > LOCALLY_SHARED).astype(np.uint8)
    return np.asarray(cv2.dilate(alike, np.ones((SHARED_SIDE_PX,) * 2)) > 0)


def _likeness(left: Pixels, right: Pixels) -> Float32:
    """Correlation of the fine detail of two images at the same pixels, in the square around each, (H, W)."""
    one, other = _fine_detail(left), _fine_detail(right)
    both, *energies = (cv2.blur(product, (SHARED_SIDE_PX,) * 2) for product in (one * other, one * one, other * other))
    return np.asarray(both / np.sqrt(energies[0] * energies[1] + 1))


def even_contrast(image: Pixels, pattern: Float32 | None = None) -> Pixels:
    """The gray image without what changes slowly, without a pattern, and with the same contrast everywhere.

    Neighbours with opposite headings see a light that moves with the camera in opposite directions. Where contrast is
    low, it decides what a descriptor compares.
    """
    gray = to_gray(image).astype(np.float32)
    if pattern is not None:
        gray -= pattern
    detail = gray - cv2.GaussianBlur(gray, (0, 0), DETAIL_SIGMA_PX)
    spread = np.sqrt(cv2.GaussianBlur(detail * detail, (0, 0), 2 * DETAIL_SIGMA_PX))
    return np.asarray(np.clip(np.rint(128 + EVEN_SPREAD * detail / (spread + 1)), 0, 255), np.uint8)


def _fine_detail(image: Pixels) -> Float32:
    gray = to_gray(image).astype(np.float32)
    return np.asarray(gray - cv2.GaussianBlur(gray, (0, 0), PATTERN_SIGMA_PX))
