"""Building blocks for any design: delays, skid buffer, adder trees, population counts, typed views."""
