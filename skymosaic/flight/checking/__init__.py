"""Whether a flight that was laid out is good, and where to fly again."""
