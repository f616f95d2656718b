"""Scores of proposed homographies: one match a clock, without a division."""
