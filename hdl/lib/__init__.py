"""Building blocks for any design: delays, skid buffer, adder trees, counts, views; multiplier and line memory."""
