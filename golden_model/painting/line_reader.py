"""A canvas in lines, as AXI4-Stream video carries it to a display (UG934)."""

import numpy as np
from numpy.typing import NDArray

from golden_model.painting.tiles import TILE_PX


def show(tiles: NDArray[np.uint8], lines: int, border: int) -> NDArray[np.int64]:
    """Data of the pixels of a picture, (lines, 32 columns): green in the lowest byte, then blue, red.

    Parameters
    ----------
    tiles : uint8 ndarray, shape (rows, columns, 32, 32, 4)
        Blue, green, red and weight (`golden_model.painting.painter.Painter.memory`).
    lines : int
        The upper ones are shown, 1 to 32 rows.
    border : int
        What is shown where the weight is 0, 24 bits.
    """
    rows, columns = tiles.shape[:2]
    pixels = tiles.swapaxes(1, 2).reshape(rows * TILE_PX, columns * TILE_PX, 4)[:lines].astype(np.int64)
    blue, green, red, weight = np.moveaxis(pixels, -1, 0)
    return np.where(weight > 0, green | blue << 8 | red << 16, border)


def bursts(columns: int, lines: int) -> NDArray[np.int64]:
    """Where each part of 32 px lies that is read, (lines * columns,), in units of 128 bytes from the canvas on."""
    line, column = np.mgrid[:lines, :columns]
    found: NDArray[np.int64] = ((line // TILE_PX * columns + column) * TILE_PX + line % TILE_PX).ravel()
    return found
