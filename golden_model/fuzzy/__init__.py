"""Zero-order Sugeno systems in real numbers: read from FLL files, and turned into the tables of the integer model."""
