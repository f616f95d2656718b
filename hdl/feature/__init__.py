"""Blocks that describe a corner: ring window, orientation, ILBP descriptor, sub-pixel position."""
