"""Tracks an object's outline through a video."""
