"""Photographs, videos and maps: reading, lens correction, metadata, writing."""
