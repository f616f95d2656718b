"""Blocks that match two frames' descriptors and weigh the matches by fuzzy rules."""
