"""Mosaics that grow while frames arrive."""
