"""A layout's place on the map: cameras, positions and control points."""
