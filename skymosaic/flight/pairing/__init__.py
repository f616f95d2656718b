"""Which pairs of a flight are matched, what no pair links, and what belongs to no pair."""
