"""Tiles of the canvas."""

TILE_PX = 32
MAX_TILES = 128
"""Columns, and rows, of the largest canvas: 4096 px."""
