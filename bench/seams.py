"""How far lines step at the seams of a mosaic, by patches of one side that are looked for on the other."""

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Mask
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.picture.composition import MEMORY_BYTES, Composition
from skymosaic.maps.geotiff import Shown

POINTS = 600
"""Places on seams, drawn from all of them."""
PATCH_PX, REACH_PX = 41, 40
"""Side of a patch of the mosaic, and how far it is looked for."""
MIN_CONTRAST, MIN_CORRELATION, MAX_RETURN_PX = 4.0, 0.7, 2.0
"""Gray levels (standard deviation) of a patch with texture; how well it has to fit; and how near to its place the patch
found there has to be found again: what repeats itself tells nothing."""


def measure_steps(composition: Composition, shown: Shown) -> Array:
    """The step at each place on a seam that both photographs show and that tells, (N,), px of the mosaic.

    ``shown`` says which photograph each pixel shows, see `Composition.bands`.
    """
    layers = {each.source.index + 1: composition.layer(each, MEMORY_BYTES) for each in composition.placements}
    left, right = shown[:, :-1], shown[:, 1:]
    rows, columns = np.nonzero((left != right) & (left > 0) & (right > 0))
    drawn = np.random.default_rng(0).permutation(len(rows))[:POINTS]
    steps = list[float]()
    for row, column in zip(rows[drawn].tolist(), columns[drawn].tolist(), strict=True):
        one, other = layers[int(left[row, column])], layers[int(right[row, column])]
        middle = Canvas(composition.canvas.x_px + column, composition.canvas.y_px + row, 1, 1)
        if (there := find_offset(one, other, middle)) is None:
            continue
        moved = Canvas(middle.x_px + there[0], middle.y_px + there[1], 1, 1)
        back = find_offset(other, one, moved)
        if back is not None and np.hypot(*np.add(there, back)) <= MAX_RETURN_PX:
            steps.append(float(np.hypot(*there)))
    return np.array(steps)


def find_offset(one: Layer, other: Layer, middle: Canvas) -> tuple[int, int] | None:
    """By how much a patch of one layer has to be moved to fit the other one, (x, y), px; None where it cannot tell."""
    around = middle.grown(PATCH_PX // 2 + REACH_PX)
    patch, wide = _look(one, middle.grown(PATCH_PX // 2)), _look(other, around)
    if patch is None or wide is None or patch.std() < MIN_CONTRAST:
        return None
    _, best, _, (x, y) = cv2.minMaxLoc(cv2.matchTemplate(wide, patch, cv2.TM_CCOEFF_NORMED))
    return (x - REACH_PX, y - REACH_PX) if best >= MIN_CORRELATION else None


def _look(layer: Layer, part: Canvas) -> Float32 | None:
    """What a layer shows in a part, gray levels, (H, W); None where it does not cover it."""
    covered: Mask = layer.border_distance(part) > 0
    if not covered.all():
        return None
    pixels = layer.pixels(part, cv2.INTER_LINEAR)
    gray = pixels.mean(axis=2) if pixels.ndim == 3 else pixels
    return np.asarray(gray, np.float32) * np.float32(255 / np.iinfo(pixels.dtype).max)
