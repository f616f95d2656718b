"""Description of a corner: orientation, ILBP descriptor, sub-pixel position."""
