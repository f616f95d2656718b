"""Building blocks for any design: components, delays, skid buffer, adder trees, counts, views; multiplier, memory."""
