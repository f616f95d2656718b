"""A camera's frames painted where their poses say: tiles, positions, pixels."""
