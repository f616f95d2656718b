"""A layout becomes a picture: composition, blending and output."""
