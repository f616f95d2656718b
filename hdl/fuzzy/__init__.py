"""Zero-order Sugeno systems, generated from the integer model."""
