"""Which corners of a frame become features: the best of each cell."""
