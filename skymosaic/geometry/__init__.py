"""Homographies and how to estimate them robustly from matched points."""
