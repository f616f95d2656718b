"""Recognises photographs whose colours are those of a palette, as thermal cameras show temperatures."""

from collections.abc import Sequence

import numpy as np

from golden_model.arrays import Array, Intensities

CELL = 32
"""Side of the cells of the colour cube in which a palette is nearly straight, gray levels."""
MIN_PIXELS = 30
"""Fewer say nothing about the spread of the colours in a cell."""
MAX_PIXELS = 100_000
MIN_COLOUR = 25.0
"""Root mean square distance of a palette's colours from a line through black, gray levels: a tinted gray harms little.
"""
MIN_STRAIGHTNESS = 1.35
"""Spread of the colours in a cell across the direction to black, over that across their own: of photographs at most
1.25, because what changes is light; of palettes 4, and 1.4 to 2 after strong compression.
"""


def have_palette(images: Sequence[Intensities]) -> bool:
    """Whether the colours of photographs (H, W, 3), BGR of 8 bits, are those of one palette.

    In a photograph colours grow lighter and darker together: nearby ones differ most along the line to black. Those of
    a palette differ along the palette, which leads from one hue to another.
    """
    colours = np.concatenate([image.reshape(-1, 3) for image in images]).astype(np.float64)
    colours = colours[:: -(-len(colours) // MAX_PIXELS)]
    off_line = np.linalg.eigvalsh(colours.T @ colours / len(colours))[:2].sum()
    if off_line < MIN_COLOUR**2:
        return False
    across_light, across = np.sum([_spread(cell) for cell in _cells(colours)], axis=0)
    return bool(across_light >= MIN_STRAIGHTNESS**2 * across)


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
