"""Recognises photographs whose colours are those of a palette, as thermal cameras show temperatures."""

from collections.abc import Sequence

import cv2
import numpy as np

from golden_model.arrays import Array, Intensities

STEP_PX = 4
"""Thumbnail pixels to the next colour, which is the mean of as many: JPEG's errors and detail average out."""
CELL = 32
"""Side of the cells of the colour cube in which a palette is nearly straight, gray levels."""
MIN_PIXELS = 30
"""Fewer say nothing about the spread of the colours in a cell."""
MAX_CHANGES = 100_000
MIN_COLOUR = 25.0
"""Root mean square distance of a palette's colours from a line through black, gray levels: a tinted gray harms little.
"""
MIN_HUE = 0.28
"""Share of the squares of changes that lies across the direction to black: of photographs at most .18, because what
changes is light, of near infrared ones .25; of palettes .32 to .97, however strong the compression (magma .22)."""
MIN_STRAIGHTNESS = 1.25
"""Spread of the colours in a cell across the direction to black, over that across their own, in the calmer half of the
picture: of palettes 1.2 to 14; where two saturated kinds of ground meet, hue changes too, but each has at most 1.18."""


def have_palette(images: Sequence[Intensities]) -> bool:
    """Whether the colours of photographs (H, W, 3), BGR of 8 bits, are those of one palette.

    In a photograph colours grow lighter and darker together: from place to place they change most along the line to
    black. Those of a palette change along the palette, which leads from one hue to another.
    """
    rows = np.concatenate([_changes(image) for image in images])
    colours, changes = np.split(rows[:: -(-len(rows) // MAX_CHANGES) or 1], 2, axis=1)
    off_line = np.linalg.eigvalsh(colours.T @ colours / max(len(colours), 1))[:2].sum()
    squares = (changes**2).sum(axis=1)
    lighter = (changes * colours).sum(axis=1) / np.maximum(np.linalg.norm(colours, axis=1), 1e-9)
    if off_line < MIN_COLOUR**2 or (squares - lighter**2).sum() < MIN_HUE * squares.sum():
        return False
    calm = _cells(colours[squares <= np.median(squares)])
    across_light, across = np.sum([(0.0, 0.0), *(_spread(cell) for cell in calm)], axis=0)
    return bool(across_light > MIN_STRAIGHTNESS**2 * across)


def _changes(image: Intensities) -> Array:
    """From each colour to those to its right and below it: the mean of the two, and their difference, (N, 6)."""
    colours = cv2.blur(image, (STEP_PX, STEP_PX))[::STEP_PX, ::STEP_PX].astype(np.float64)
    pairs = [(colours[:, :-1], colours[:, 1:]), (colours[:-1], colours[1:])]
    return np.concatenate([np.dstack([(one + other) / 2, other - one]).reshape(-1, 6) for one, other in pairs])


def _cells(colours: Array) -> list[Array]:
    """The colours of each cell that has enough."""
    keys = (colours // CELL).astype(np.int64) @ (1, 8, 64)
    order = np.argsort(keys, kind="stable")
    parts = np.split(colours[order], np.flatnonzero(np.diff(keys[order])) + 1)
    return [part for part in parts if len(part) >= MIN_PIXELS]


def _spread(colours: Array) -> tuple[float, float]:
    """Sums of squares of the colours of a cell (N, 3), across the direction to black and across their own direction."""
    mean = colours.mean(axis=0)
    squares = (colours - mean).T @ (colours - mean)
    light = mean / max(float(np.linalg.norm(mean)), 1e-9)
    return float(np.trace(squares) - light @ squares @ light), float(np.linalg.eigvalsh(squares)[:2].sum())
