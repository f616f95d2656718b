"""Measuring results: metrics, pairs with known homographies, hardware against golden model."""
