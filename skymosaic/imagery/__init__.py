"""Reads photographs, videos and their metadata, corrects lenses, and writes pictures."""
