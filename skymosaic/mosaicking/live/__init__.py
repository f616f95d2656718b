"""Live mosaics, which grow while frames arrive."""
