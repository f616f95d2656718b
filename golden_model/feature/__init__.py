"""What describes a corner: orientation, ILBP descriptor, sub-pixel position."""
