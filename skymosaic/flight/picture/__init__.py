"""A layout becomes a picture: relief, composition, further bands, blending and output."""
