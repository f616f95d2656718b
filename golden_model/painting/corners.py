"""Where the corners of a tile's cells lie in the frame."""

from golden_model.formats import SQ
from golden_model.painting.tiles import TILE_PX

CELL_PX = 16
SIDE = TILE_PX // CELL_PX + 1
"""Corners along each side of a tile."""
CORNER = SQ(15, 8)
"""A coordinate in the frame, px."""
