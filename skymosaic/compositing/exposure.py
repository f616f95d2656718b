"""Exposure compensation: gains that make overlapping images equally bright."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.compositing.blend import layers_of
from skymosaic.compositing.warp import Canvas, footprint

PREVIEW_PX = 1_000_000
"""Area of the reduced canvas on which overlaps are compared."""
INTENSITY_SIGMA = 10.0
"""Expected spread of the mean intensities of an overlap, in gray levels."""
GAIN_SIGMA = 0.5
"""Expected spread of the gains around 1; wide, so that the overlaps decide and the 1 only anchors their level."""


def exposure_gains(images: Sequence[Pixels], transforms: Sequence[Array], canvas: Canvas) -> Array:
    """One gain per image, so that the mean intensities of each overlap agree (Brown and Lowe 2007, equation 29).

    Parameters
    ----------
    images, transforms, canvas
        As in `skymosaic.compositing.blend.blend`; the images are compared on a canvas of about a megapixel.

    Returns
    -------
    (N,) float64 ndarray
        Gains around 1; exactly 1 for an image that overlaps no other.
    """
    scale = min(1.0, (PREVIEW_PX / (canvas.width_px * canvas.height_px)) ** 0.5)
    reduced = [np.diag([scale, scale, 1.0]) @ transform for transform in transforms]
    layers = layers_of([_as_gray(image) for image in images], reduced, np.ones(len(images)))
    windows = [footprint(layer.size, layer.transform) for layer in layers]
    gray = [layer.pixels(window) for layer, window in zip(layers, windows, strict=True)]
    seen = [layer.border_distance(window) > 0 for layer, window in zip(layers, windows, strict=True)]
    system = np.diag([np.count_nonzero(mask) / GAIN_SIGMA**2 for mask in seen])
    target = system.diagonal().copy()
    for i, j in combinations(range(len(layers)), 2):
        overlap = windows[i].intersection(windows[j])
        if overlap is None:
            continue
        in_i, in_j = overlap.within(windows[i]), overlap.within(windows[j])
        both = seen[i][in_i] & seen[j][in_j]
        if both.any():
            means = np.array([gray[i][in_i][both].mean(), -gray[j][in_j][both].mean()])
            system[np.ix_((i, j), (i, j))] += np.count_nonzero(both) / INTENSITY_SIGMA**2 * np.outer(means, means)
    return np.asarray(np.linalg.solve(system, target))


def _as_gray(image: Pixels) -> Pixels:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
