"""How far lines step at the seams of a mosaic, by patches of one side that are looked for on the other."""

from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from golden_model.arrays import Array, Float32
from skymosaic.compositing.blend import find_owners
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.picture.composition import MEMORY_BYTES
from skymosaic.flight.picture.preparation import compose

TURNS_DEG = range(0, 90, 10)
"""On a canvas that lies another way, seams cut other trees. Of ten photographs, one canvas has some twenty seams, and
the 90th percentile of its steps was 2 to 10 px by how it lay."""
POINTS = 150
"""Places on the seams of each canvas, drawn from all of them."""
PATCH_PX, REACH_PX = 41, 40
"""Side of a patch of the mosaic, and how far it is looked for."""
MIN_CONTRAST, MIN_CORRELATION, MAX_RETURN_PX = 4.0, 0.7, 2.0
"""Gray levels (standard deviation) of a patch with texture; how well it has to fit; and how near to its place the patch
found there has to be found again: what repeats itself tells nothing."""


def measure_steps(flight: Flight, layout: Layout) -> Array:
    """The step at each place on a seam that both photographs show and that tells, (N,), px of the mosaic."""
    steps = list[float]()
    for turn in Rotation.from_rotvec(np.outer(TURNS_DEG, (0, 0, 1)), degrees=True).as_matrix():
        turned = {member: turn @ transform for member, transform in layout.transforms.items()}
        composition = compose(flight, replace(layout, transforms=turned))
        layers, canvas = [composition.layer(each, MEMORY_BYTES) for each in composition.placements], composition.canvas
        owner, _ = find_owners(layers, canvas)
        left, right = owner[:, :-1], owner[:, 1:]
        places = np.argwhere((left != right) & (left >= 0) & (right >= 0))
        for row, column in np.random.default_rng(0).permutation(places)[:POINTS].tolist():
            middle = Canvas(canvas.x_px + column, canvas.y_px + row, 1, 1)
            one, other = layers[left[row, column]], layers[right[row, column]]
            there = find_offset(one, other, middle)
            back = there and find_offset(other, one, Canvas(middle.x_px + there[0], middle.y_px + there[1], 1, 1))
            if there and back and np.hypot(*np.add(there, back)) <= MAX_RETURN_PX:
                steps.append(float(np.hypot(*there)))
    return np.array(steps)


def find_offset(one: Layer, other: Layer, middle: Canvas) -> tuple[int, int] | None:
    """By how much a patch of one layer has to be moved to fit the other one, (x, y), px; None where it cannot tell."""
    patch, wide = _look(one, middle.grown(PATCH_PX // 2)), _look(other, middle.grown(PATCH_PX // 2 + REACH_PX))
    if patch is None or wide is None or patch.std() < MIN_CONTRAST:
        return None
    _, best, _, (x, y) = cv2.minMaxLoc(cv2.matchTemplate(wide, patch, cv2.TM_CCOEFF_NORMED))
    return (x - REACH_PX, y - REACH_PX) if best >= MIN_CORRELATION else None


def _look(layer: Layer, part: Canvas) -> Float32 | None:
    """What a layer shows in a part, gray levels, (H, W); None where it does not cover it."""
    if not layer.border_distance(part).all():
        return None
    pixels = layer.pixels(part, cv2.INTER_LINEAR)
    return np.atleast_3d(pixels).mean(axis=2, dtype=np.float32) * np.float32(255 / np.iinfo(pixels.dtype).max)
