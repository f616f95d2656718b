"""Whole flights: which photographs overlap, where each lies, and the mosaic they make."""
