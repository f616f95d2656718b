"""Tiles of the canvas."""

from amaranth.lib import data

from golden_model.painting.tiles import MAX_TILES

TILE = data.StructLayout({"column": range(MAX_TILES), "row": range(MAX_TILES)})
