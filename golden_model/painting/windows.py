"""The part of a frame that a tile needs, and tiles that need not be painted.

Positions of a tile's pixels lie between the corners of its cells, so the box around the corners holds them all.
"""

import numpy as np
from numpy.typing import NDArray

from golden_model.painting.blending import FADE
from golden_model.painting.corners import CORNER
from golden_model.painting.positions import POSITION
from golden_model.painting.sampling import weigh

WINDOW_PX = 128
"""Side of the largest part of a frame that is held for a tile: at any heading enough for 2.7 px of the frame per pixel
of the canvas, at headings along the axes for 3.9."""
NARROW_PX = WINDOW_PX // 2
"""Of parts up to this width two are held at once: while one is painted, the next is read."""


def bounding_boxes(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Boxes around all pixels of a frame that tiles need, as if the frame had no border.

    Parameters
    ----------
    corners : ndarray of int, shape (N, 3, 3, 2)
        x, y of the corners of each tile's cells, in 1/256 px.

    Returns
    -------
    ndarray of int64, shape (N, 4)
        left, top, right, bottom; inclusive, px.
    """
    # A position that is rounded up may reach the next pixel; and interpolation needs the pixel after that.
    half_position = 1 << CORNER.fraction_bits - POSITION.fraction_bits - 1
    nearest = corners + half_position >> CORNER.fraction_bits
    return np.concatenate([nearest.min(axis=(1, 2)), nearest.max(axis=(1, 2)) + 1], axis=1)


def are_too_large(boxes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether boxes (N, 4) exceed `WINDOW_PX`, (N,).

    They are not cut to the frame before: the corners of a tile that is far too large may be limited by their format.
    """
    sides = boxes[:, 2:] - boxes[:, :2] + 1
    return np.asarray(sides.max(axis=1) > WINDOW_PX)


def are_wide(boxes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether boxes (N, 4), cut to the frame, are wider than `NARROW_PX`, (N,)."""
    return np.asarray(boxes[:, 2] - boxes[:, 0] >= NARROW_PX)


def can_win(boxes: NDArray[np.int64], width_px: int, height_px: int, least: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether painting a tile could change the canvas.

    Parameters
    ----------
    boxes : ndarray of int, shape (N, 4)
        From `bounding_boxes`.
    width_px, height_px : int
        Size of the frame.
    least : ndarray of int, shape (N,)
        Smallest weight on the canvas in each tile.

    Returns
    -------
    ndarray of bool, shape (N,)
        Never False for a tile of which `golden_model.painting.blending.blend` would change a pixel.
    """
    # Each of the four distances to the border is largest at a side of the box; the least of them bounds the weight.
    to_border = np.concatenate([boxes[:, 2:], np.array([width_px, height_px]) - 1 - boxes[:, :2]], axis=1)
    weights = weigh(to_border.min(axis=1), width_px, height_px)
    return (weights > 0) & (weights + FADE // 2 > least)


def cut_to_frame(boxes: NDArray[np.int64], width_px: int, height_px: int) -> NDArray[np.int64]:
    """Cut boxes (N, 4) to what is inside the frame; those of tiles that cannot win may be empty."""
    least, most = np.maximum(boxes[:, :2], 0), np.minimum(boxes[:, 2:], (width_px - 1, height_px - 1))
    return np.concatenate([least, most], axis=1)
