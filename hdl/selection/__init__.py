"""Blocks that choose the features of a frame, order them and serialise their records."""
