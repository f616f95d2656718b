"""Places on the ground: georeferences, control points, GeoTIFF and map tiles."""
