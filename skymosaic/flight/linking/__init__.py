"""Which photographs of a flight overlap, and by which homographies."""
