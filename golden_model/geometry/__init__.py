"""Scores of proposed homographies, in the integers of the hardware."""
