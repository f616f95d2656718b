"""Matching of descriptors and of windows, and the fuzzy rules that give each match a weight."""
