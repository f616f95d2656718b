"""Scores of proposed homographies: one match per clock, without a division."""
