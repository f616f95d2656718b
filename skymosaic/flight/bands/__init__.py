"""Multi-band cameras: their lenses against each other, and their bands as layers."""
