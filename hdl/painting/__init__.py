"""Frames painted where their poses say, as `golden_model.painting` defines it."""
