"""Building blocks that know nothing of images: delays, skid buffer, adder trees, population counts."""
