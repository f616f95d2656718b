"""Selection of the corners that become features: the best of each cell."""
